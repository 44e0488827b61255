"""`jaxgeo calibrate`: learn the odometry noise of a session, and nothing else."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from jaxgeo.cli.progress import Progress
from jaxgeo.config import load_config
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import ConfigError
from jaxgeo.export.result import DriftGrowth
from jaxgeo.io.atomic import check_output_folder, output_folder

NOISE_FILE, PAGE_FILE = "noise.json", "calibration.html"


def calibrate_config(path: Path, out: Path | None, overrides: Sequence[str], quiet: bool) -> None:
    """Learn, print, and write noise.json and calibration.html.

    Raises:
        JaxgeoError: bad input, or anchors that do not fix the frame; nothing is written then.
    """
    config = load_config(path, overrides)
    if config.noise.mode == "fixed":
        raise ConfigError(
            f"{path}: noise.mode is 'fixed', and jaxgeo calibrate learns; remove it, or add --set noise.mode=learned"
        )
    out = Path("out") / config.name if out is None else out
    check_output_folder(out)

    from jaxgeo.cli.run import keep_compiled_programs
    from jaxgeo.export.calibration_page import calibration_html
    from jaxgeo.export.noise_file import noise_json

    keep_compiled_programs()
    with Progress(quiet) as progress:
        noise, growth, warnings = learn_session(config, progress, out)
        progress.phase("write", str(out))
        learned = {name: stages["learned"] for name, stages in noise.items()}
        page = calibration_html(config.name, learned, growth, warnings, simulated=config.simulated)
        text = noise_json(config.name, config.simulated, noise)
        with output_folder(out) as temporary:
            (temporary / NOISE_FILE).write_text(text, encoding="utf-8", newline="\n")
            (temporary / PAGE_FILE).write_text(page, encoding="utf-8", newline="\n")
    if not quiet:
        for warning in warnings:
            print(f"warning: {warning}", file=sys.stderr)
        for name, values in learned.items():
            print_learned(name, values)
        label = " (simulated data)" if config.simulated else ""
        print(f"{config.name}{label}: {out / PAGE_FILE}")


def learn_session(
    config: SessionConfig, progress: Progress, out: Path | None = None
) -> tuple[dict[str, dict[str, Any]], dict[str, DriftGrowth], tuple[str, ...]]:
    """Noise by trajectory and stage, as in noise.json; predicted and observed drift; warnings.

    Raises:
        InputError, EstimationError: as of a run; errors name the trajectory.
    """
    from calibration.calibrate import calibrate_and_correct
    from calibration.profile import profile_likelihoods
    from eval.drift_growth import drift_growth
    from jaxgeo.cli.ingest import ingest
    from jaxgeo.cli.noise import learn_settings, learned_values, noise_of, noise_values, profile_values, stored_noise
    from jaxgeo.cli.session import Clock, anchored, named, settings_of
    from jaxgeo.cli.session_corrections import as_recorded
    from jaxgeo.graph.components import ensemble_of
    from jaxgeo.solve.correct import correct

    progress.phase("read", config.name)
    data = ingest(config, progress, out)
    noise: dict[str, dict[str, Any]] = {}
    growth: dict[str, DriftGrowth] = {}
    warnings = list(as_recorded(config, "jaxgeo calibrate"))
    for name, source in config.trajectories.items():
        with named(name):
            settings, fixed = settings_of(config), noise_of(source, config)
            clock = Clock(progress, name)
            trajectory, anchors, said = anchored(name, settings, data, clock)
            # Says whether the anchors fix the frame; nothing may be learned where they do not.
            clock.phase("correct")
            found = correct(trajectory, anchors, fixed, settings)
            clock.phase("learn")
            start = learn_settings(config, source, fixed, stored_noise(config, source))
            calibration, _, learned = calibrate_and_correct(
                trajectory, anchors, settings, start, np.zeros((0, len(anchors)))
            )
            clock.phase("profile")
            profiles = profile_likelihoods(_first(learned))
            noise[name] = {
                "fixed": noise_values(fixed),
                "learned": learned_values(calibration) | {"profiles": profile_values(profiles)},
            }
            misclosure_m = np.asarray(found.fold.coarse_point_m)[: len(anchors)] - anchors.surveyed_enh_m
            scale = float(found.fold.coarse.scale)
            growth[name] = drift_growth(
                trajectory, anchors, scale, misclosure_m, ensemble_of(fixed), calibration.ensemble
            )
            clock.end()
            warnings += [f"{name}: {sentence}" for sentence in said]
    return noise, growth, tuple(warnings)


def _first(learned: Any) -> Any:
    import jax

    return jax.tree.map(lambda x: x[0], learned)


def print_learned(name: str, learned: dict[str, Any], console: Console | None = None) -> None:
    """The sigmas, the models and the sentences of one trajectory, on the terminal."""
    from jaxgeo.export.noise_words import COMPONENT, MODEL, in_words, noise_number, single_axis

    console = console or Console(highlight=False)
    table = Table("noise", "prior", "learned", "95 % range", "models", title=name, title_justify="left", box=SIMPLE)
    for s in sorted(learned["sigmas"], key=lambda s: list(COMPONENT).index(s["component"])):
        component = s["component"]
        if single_axis(component):
            continue
        table.add_row(
            f"{COMPONENT[component].name} ({COMPONENT[component].when})",
            noise_number(component, s["prior_median"]),
            noise_number(component, s["median"]),
            f"{noise_number(component, s['low_95'])} … {noise_number(component, s['high_95'])}",
            f"{100 * s['probability']:.0f} %",
        )
    console.print(table)
    models = Table("model", "it has", "probability", box=SIMPLE)
    for m in learned["models"]:
        models.add_row(m["name"], MODEL.get(m["name"], ""), f"{100 * m['weight']:.0f} %")
    console.print(models)
    for sentence in learned["sentences"]:
        console.print(f"- {in_words(sentence)}", markup=False)
