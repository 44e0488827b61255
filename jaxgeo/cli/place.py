"""`jaxgeo place` and `jaxgeo predict`: one config in, one folder with a plan out."""

import platform
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxgeo.cli.progress import Progress
from jaxgeo.config import dump_config
from jaxgeo.config.load import read_config
from jaxgeo.config.placement import PlacementConfig
from jaxgeo.errors import ConfigError, InputError
from jaxgeo.io.atomic import check_output_folder

if TYPE_CHECKING:
    from eval.placement.answer import PlacementAnswer
    from eval.placement_report.report import PlacementReport
    from jaxgeo.cli.placement_inputs import PlacementInputs, Places

_VERSIONS = ("jax", "jaxlib", "optimistix", "lineax", "equinox", "numpy", "scipy", "pyproj")


def print_placement_config(path: Path, overrides: Sequence[str]) -> None:
    """Print the resolved config."""
    sys.stdout.write(dump_config(read_config(path, PlacementConfig, overrides)))


def place_config(path: Path, out: Path | None, overrides: Sequence[str], quiet: bool) -> None:
    """Search the best anchors, print how the layouts compare, and write the plan.

    Raises:
        InputError: bad input.
        UndeterminedError: no layout found fixes the frame. Nothing is written then.
    """
    config = read_config(path, PlacementConfig, overrides)
    if not config.anchors.count:
        raise ConfigError(
            f"{path}: anchors.count is missing: how many anchors to place, such as 6, or several numbers to compare. "
            "`jaxgeo predict` asks about a given layout."
        )
    out = Path("out") / config.name if out is None else out
    check_output_folder(out)

    from eval.placement.planned import place_anchors
    from jaxgeo.cli.placement_checks import refuse_open_frame
    from jaxgeo.cli.placement_inputs import placement_inputs
    from jaxgeo.cli.run import keep_compiled_programs

    keep_compiled_programs()
    started = time.perf_counter()
    with Progress(quiet) as progress:
        progress.phase("read", config.name)
        inputs = placement_inputs(config, with_layout=False)
        answers = place_anchors(inputs.path, inputs.noise, inputs.given, progress.phase)
        for answer in answers:
            refuse_open_frame(answer.chosen, inputs)
        report = _report(config, inputs, answers, False, time.perf_counter() - started)
        _finish(report, out, progress)
    _say(report, out, quiet)


def predict_config(path: Path, out: Path | None, overrides: Sequence[str], quiet: bool) -> None:
    """Predict what a given layout promises, print and write it.

    Raises:
        InputError: bad input.
        UndeterminedError: the layout does not fix the frame. Nothing is written then.
    """
    config = read_config(path, PlacementConfig, overrides)
    if config.layout is None and config.anchors.standing is None:
        raise ConfigError(
            f"{path}: no anchors are given: add 'layout: {{file: anchors.csv}}' or 'layout: {{points: ..}}' (and "
            "'anchors.standing', those that stand already). `jaxgeo place` says where to put them."
        )
    out = Path("out") / config.name / "predicted" if out is None else out
    check_output_folder(out)

    from eval.placement.planned import predict_layout
    from jaxgeo.cli.placement_checks import refuse_one_line, refuse_open_frame
    from jaxgeo.cli.placement_inputs import placement_inputs
    from jaxgeo.cli.run import keep_compiled_programs

    keep_compiled_programs()
    started = time.perf_counter()
    with Progress(quiet) as progress:
        progress.phase("read", config.name)
        inputs = placement_inputs(config, with_layout=True)
        names, point_m = _together(inputs.layout, inputs)
        refuse_one_line(point_m, inputs)
        progress.phase("predict")
        answer = predict_layout(inputs.path, inputs.noise, inputs.given, point_m, names)
        refuse_open_frame(answer.chosen, inputs)
        report = _report(config, inputs, (answer,), True, time.perf_counter() - started)
        _finish(report, out, progress)
    _say(report, out, quiet)


def _together(layout: "Places", inputs: "PlacementInputs") -> tuple[tuple[str, ...], np.ndarray]:
    """The layout and what stands already; one that is in both counts once."""
    given = inputs.given
    names, point_m = list(layout.name), list(layout.point_m)
    for name, point in zip(given.standing_name, given.standing_m, strict=True):
        if name not in names:
            names.append(name)
            point_m.append(point)
            continue
        apart_m = float(np.linalg.norm(point_m[names.index(name)] - point))
        if apart_m > 1e-3:
            raise InputError(
                f"layout and anchors.standing give {name!r} at places {apart_m:.3f} m apart; expected one place. Mend "
                "one of them, or rename it."
            )
    return tuple(names), np.array(point_m).reshape(-1, 3)


def _report(
    config: PlacementConfig,
    inputs: "PlacementInputs",
    answers: "tuple[PlacementAnswer, ...]",
    predicted: bool,
    seconds: float,
) -> "PlacementReport":
    from eval.placement_report.report import PlacementReport
    from jaxgeo.cli.ingest import file_hashes
    from jaxgeo.cli.input_identity import facts_key
    from jaxgeo.cli.placement_checks import oddities

    resolved = config.model_dump(mode="json")
    run: dict[str, Any] = {
        "versions": {"jaxgeo": version("jaxgeo"), "python": platform.python_version()}
        | {name: version(name) for name in _VERSIONS},
        "inputs_sha256": file_hashes(inputs.files),
        "config_sha256": facts_key(resolved),
        "seed": config.seed,
        "timing_s": {"total": seconds},
    }
    return PlacementReport(
        name=config.name,
        simulated=inputs.simulated,
        frame=inputs.frame,
        path=inputs.path,
        path_said=inputs.path_said,
        noise=inputs.noise_facts,
        given=inputs.given,
        answers=answers,
        predicted=predicted,
        config=resolved,
        run=run,
        warnings=(*inputs.warnings, *oddities(inputs, answers, predicted)),
        basemap=inputs.basemap,
    )


def _finish(report: "PlacementReport", out: Path, progress: Progress) -> None:
    from jaxgeo.cli.placement_files import write_placement

    progress.phase("write", str(out))
    write_placement(report, out)


def _say(report: "PlacementReport", out: Path, quiet: bool) -> None:
    """Warnings to stderr; the tables and what was written to stdout."""
    if quiet:
        return
    from eval.placement_report.tables import counts_table, layouts_table
    from eval.placement_report.words import verdict_words
    from jaxgeo.cli.printed_table import print_table

    for warning in report.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    for answer in report.answers:
        if len(answer.layouts) > 1:
            print_table(layouts_table(answer))
    if len(report.answers) > 1:
        print_table(counts_table(report))
    for answer in report.answers:
        print(next(verdict_words(report, answer)))
    label = " (simulated data)" if report.simulated else ""
    print(f"{report.name}{label}: {out / 'placement.html'}")
