"""Ways to the noise, side by side: `python -m benchmarks.noise_baselines CONFIG... [--transfer CONFIG] [--simulated]`.

For every trajectory of the configs, and for simulated sessions, held-out errors of the one-time similarity, of the
fixed noise and of the noise found in every other way; `--transfer` learns on that config's trajectory of the same kind
of odometry and applies it to the others.
"""

import dataclasses
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import typer

from benchmarks.sessions import ROOT, length, share
from calibration.calibrate import LearnSettings, calibrate
from eval.montecarlo.settings import LAYOUT
from eval.noise_baselines import NoiseBaseline, noise_baselines
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.session import noise_of, settings_of
from jaxgeo.config import load_config
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise, odometry_noise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.precision import enable_compilation_cache
from jaxgeo.simulate import Drift, Layout, simulate_session
from jaxgeo.simulate.layout import ORDER, ORIGIN_ENH_M
from jaxgeo.solve.correct import Settings

# White noise and a constant bias of the sizes that indoor LiDAR odometry has; the bias itself is drawn.
SIGMA_TRANS, SIGMA_ROT, SIGMA_BIAS_TRANS, SIGMA_BIAS_ROT = 0.02, 0.002, 0.015, 0.001
_GAP_S = 5.0


@dataclasses.dataclass(frozen=True)
class Problem:
    """One trajectory to be judged; `true` where it was simulated from a known noise."""

    title: str
    trajectory: Trajectory
    anchors: Anchors
    settings: Settings
    learn: LearnSettings
    true: OdometryNoise | None = None

    def print_table(self, transferred: NoiseEnsemble | None = None) -> None:
        started = time.perf_counter()
        rows = noise_baselines(
            self.trajectory, self.anchors, self.settings, self.learn, transferred=transferred, true=self.true
        )
        print_table(self.title, rows, time.perf_counter() - started)


def problems_of(path: Path) -> Iterator[Problem]:
    """Every trajectory of a config, with its anchors and settings."""
    config = load_config(path, [])
    data = ingest(config)
    for name, source in config.trajectories.items():
        trajectory = data.trajectories[name]
        anchors, _ = make_anchors(
            trajectory, data.sightings, data.visits, data.survey, origin_enh_m=data.frame.origin_enh_m
        )
        learn = LearnSettings(source.odometry, noise_of(source, config))
        label = f"{config.name} {name}" + (" (simulated)" if config.simulated else "")
        yield Problem(label, trajectory, anchors, settings_of(config), learn)


def simulated_problem(seed: int, layout: Layout = LAYOUT) -> Problem:
    """A simulated session whose noise, bias included, was drawn from one that is known."""
    random = np.random.default_rng([seed, 1])
    drift = Drift(
        (SIGMA_TRANS, SIGMA_TRANS, SIGMA_TRANS),
        (SIGMA_ROT, SIGMA_ROT, SIGMA_ROT),
        0.0,
        tuple(SIGMA_BIAS_TRANS * random.standard_normal(3)),  # type: ignore[arg-type]
        tuple(SIGMA_BIAS_ROT * random.standard_normal(3)),  # type: ignore[arg-type]
    )
    session = simulate_session(seed, layout, drift={"odometry": drift})
    trajectory = session.trajectories["odometry"]
    visits, _ = label_visits(cut_visits(session.sightings, _GAP_S), session.survey, order=list(ORDER))
    anchors, _ = make_anchors(trajectory, session.sightings, visits, session.survey, origin_enh_m=ORIGIN_ENH_M)
    true = odometry_noise(
        SIGMA_TRANS,
        SIGMA_ROT,
        sigma_bias_trans_m_per_m=SIGMA_BIAS_TRANS,
        sigma_bias_rot_rad_per_m=SIGMA_BIAS_ROT,
    )
    learn = LearnSettings("lidar", default_noise("lidar"))
    return Problem(f"simulated, seed {seed}", trajectory, anchors, Settings(), learn, true)


def learned_on(path: Path) -> dict[str, NoiseEnsemble]:
    """What is learned on a config's trajectories, by kind of odometry; the first one of each kind."""
    found: dict[str, NoiseEnsemble] = {}
    for problem in problems_of(path):
        kind = problem.learn.kind
        if kind not in found:
            found[kind] = calibrate(problem.trajectory, problem.anchors, problem.settings, problem.learn).ensemble
    return found


def print_table(title: str, rows: tuple[NoiseBaseline, ...], seconds: float) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("noise", "held out: mean", "rms", "in 50 / 95 % ellipsoid", "failed", title=title)
    for row in rows:
        coverage = "–" if np.isnan(row.coverage_50) else f"{share(row.coverage_50)} / {share(row.coverage_95)}"
        table.add_row(row.name, *length(row.mean_m, row.rms_m), coverage, str(row.n_failed or ""))
    Console().print(table, f"{seconds:.1f} s, compiling included\n")


def main(
    configs: list[Path] = typer.Argument(None, help="Sessions."),  # noqa: B008
    transfer: Path = typer.Option(None, help="Session whose learned noise is applied to the others."),  # noqa: B008
    simulated: int = typer.Option(0, help="Number of simulated sessions beside them."),
) -> None:
    os.environ.setdefault("JAXGEO_DATA", str(ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    from_elsewhere = learned_on(transfer) if transfer is not None else {}
    for path in configs or []:
        for problem in problems_of(path):
            problem.print_table(from_elsewhere.get(problem.learn.kind))
    for seed in range(simulated):
        simulated_problem(seed).print_table()


if __name__ == "__main__":
    typer.run(main)
