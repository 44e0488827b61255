"""Latency of the online estimator: `python -m benchmarks.online [--json]`. See benchmarks/README.md.

A simulated trajectory of 20 000 poses, most of its anchors near its end, and two recorded ones with the anchors of
their configs. Every anchor counts the making of its lever arm, the solve of all poses, and the covariance.
"""

import dataclasses
import gc
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import typer
from scipy.spatial.transform import RigidTransform

from benchmarks.chain import FULL, LIDAR, WHITE, drifted, walk
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.cli.machine import device_words
from jaxgeo.cli.replay import batch_positions_m, known_noise, online_settings
from jaxgeo.data import Anchors, Sightings, Survey, Trajectory
from jaxgeo.georef import LocalFrame
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import COMPONENTS, NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.online import OnlineGeoreference, OnlineSettings
from jaxgeo.online.replay import Replayed, replay
from jaxgeo.precision import enable_compilation_cache
from jaxgeo.solve.fold import fold_graph
from jaxgeo.solve.solver import SOLVER_FOR_GRADIENTS, solve_graph

POSES, RUNS, REAL_RUNS = 20_000, 5, 5
# Visits of the simulated run: a few along it, the others over its last thousand poses.
EARLY, LATE, LAST_POSES = 8, 50, 1000
SIGHTINGS_A_VISIT, GAP_S = 10, 0.15
SIGHTING_SIGMA_M, SURVEY_SIGMA_M = 0.03, 0.02
CONFIGS = ("kitti00", "mulran_kaist01")
# An ensemble as learning makes it: sixteen draws of six models, every component in some of them.
SETS, SPREAD, LEFT_OUT, CORRELATION_M = 96, 0.5, 0.2, 100.0
BESIDE_WHITE = {
    "turn_rad_per_sqrt_rad": 3e-3,
    "log_scale": 5e-3,
    "log_turn": 3e-3,
    "bias_trans_m_per_m": 1e-3,
    "bias_rot_rad_per_m": 1e-5,
    "wander_log_scale": 4e-3,
    "wander_trans_m_per_m": 1e-3,
    "wander_rot_rad_per_m": 1e-5,
    "bounded_m": 0.05,
}


def ensemble_of_many() -> NoiseEnsemble:
    """Log-normal about the LiDAR defaults and the values above; all but the white ones left out here and there."""
    rng = np.random.default_rng(0)
    median = np.asarray(ensemble_of(LIDAR).sigma[0]).copy()
    beside = [COMPONENTS.index(name) for name in BESIDE_WHITE]
    median[beside] = list(BESIDE_WHITE.values())
    sigma = median * np.exp(SPREAD * rng.standard_normal((SETS, len(median))))
    sigma[:, beside] *= rng.random((SETS, len(beside))) >= LEFT_OUT
    weight = rng.random(SETS)
    return NoiseEnsemble(jnp.asarray(sigma), jnp.asarray(weight / weight.sum()), jnp.asarray(CORRELATION_M))


NOISES: dict[str, OdometryNoise | NoiseEnsemble] = {
    "white": WHITE,
    "white, bias and scale": FULL,
    "ensemble of one": ensemble_of(LIDAR),
    f"ensemble of {SETS}": ensemble_of_many(),
}


@dataclasses.dataclass(frozen=True)
class Case:
    """What is replayed, and what the batch job makes of it."""

    trajectory: Trajectory
    sightings: Sightings
    survey: Survey
    frame: LocalFrame
    anchors: Anchors
    noise: OdometryNoise | NoiseEnsemble
    settings: OnlineSettings


def simulated(noise: OdometryNoise | NoiseEnsemble, seed: int) -> Case:
    """20 000 poses round and round, white drift, a marker of its own for every visit."""
    rng = np.random.default_rng(seed)
    truth = walk(POSES)
    trajectory = drifted(truth, WHITE, rng)
    early = np.linspace(0, POSES - LAST_POSES - 200, EARLY).astype(int)
    late = np.linspace(POSES - LAST_POSES, POSES - 2 * SIGHTINGS_A_VISIT, LATE).astype(int)
    first = np.concatenate([early, late])
    sightings, survey = _sightings(truth, trajectory.stamp_s, first, rng)
    frame = LocalFrame.create("local", np.zeros(3))
    labelled, _ = label_visits(cut_visits(sightings, GAP_S), survey)
    anchors, _ = make_anchors(trajectory, sightings, labelled, survey, origin_enh_m=frame.origin_enh_m)
    settings = OnlineSettings(gap_s=GAP_S, capacity=POSES, capacity_anchors=len(first))
    return Case(trajectory, sightings, survey, frame, anchors, noise, settings)


def _sightings(
    truth: RigidTransform, stamp_s: np.ndarray, first: np.ndarray, rng: np.random.Generator
) -> tuple[Sightings, Survey]:
    """Markers 3 m from the path, seen at successive poses from `first` on."""
    marker_m = truth[first].apply(rng.uniform(-3.0, 3.0, (len(first), 3)))
    rows = (first[:, None] + np.arange(SIGHTINGS_A_VISIT)).ravel()
    which = np.repeat(np.arange(len(first)), SIGHTINGS_A_VISIT)
    seen = truth[rows].inv().apply(marker_m[which])
    n = len(rows)
    sightings = Sightings(
        stamp_s=stamp_s[rows],
        marker=np.array([f"M{i}" for i in which]),
        t_body_marker_m=seen + SIGHTING_SIGMA_M * rng.standard_normal((n, 3)),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=np.tile(np.diag([SIGHTING_SIGMA_M**2] * 3 + [0.0] * 3), (n, 1, 1)),
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"sighting {i}" for i in range(n)]),
    )
    surveyed = marker_m + SURVEY_SIGMA_M * rng.standard_normal(marker_m.shape)
    none = np.full((len(first), 4), np.nan)
    names = tuple(f"M{i}" for i in range(len(first)))
    return sightings, Survey(names, surveyed, np.full_like(surveyed, SURVEY_SIGMA_M), none, none[:, :3], "local")


def recorded(name: str) -> Case:
    """A session of configs/."""
    from jaxgeo.cli.ingest import ingest
    from jaxgeo.cli.session import settings_of
    from jaxgeo.config import load_config

    config = load_config(Path(__file__).resolve().parents[1] / "configs" / f"{name}.yaml", ["noise.mode=fixed"])
    data = ingest(config)
    (trajectory_name,) = config.trajectories
    trajectory = data.trajectories[trajectory_name]
    anchors, _ = make_anchors(
        trajectory, data.sightings, data.visits, data.survey, origin_enh_m=data.frame.origin_enh_m
    )
    noise, _ = known_noise(config, config.trajectories[trajectory_name])
    settings = online_settings(config, len(trajectory), len(anchors))
    assert settings.solve == settings_of(config)
    return Case(trajectory, data.sightings, data.survey, data.frame, anchors, noise, settings)


def run_once(case: Case) -> Replayed:
    """One replay, everything compiled before."""
    online = OnlineGeoreference(case.survey, case.frame, case.noise, case.settings)
    online.warm_up()
    # What is there by now stays; going through it takes the collector tenths of a second. As `jaxgeo replay` does.
    gc.collect()
    gc.freeze()
    found = replay(online, case.trajectory, case.sightings)
    gc.unfreeze()
    return found


def final_difference_m(case: Case, found: Replayed) -> float:
    batch_m = batch_positions_m(case.trajectory, case.anchors, case.noise, case.settings.solve)
    return float(np.linalg.norm(found.result.corrected.position_m - batch_m, axis=1).max())


def final_from_optimum_m(case: Case, found: Replayed) -> float | None:
    """Largest distance of the end from the batch problem's optimum, solved from the coarse fit as far as it goes."""
    if not isinstance(case.noise, OdometryNoise):
        return None
    settings = case.settings.solve
    chain = chain_of(case.trajectory)
    table = anchor_table(case.anchors, chain, settings.extra_sigma_m)
    width = jnp.asarray(settings.loss_width)
    graph, _, _, origin = _fold_graph(chain, table, case.noise, table.real, width, settings.fold_options(case.noise))
    poses = _solve_graph(graph, settings.max_steps, SOLVER_FOR_GRADIENTS).poses
    optimum = np.stack(poses.t, axis=1)[: len(case.trajectory)] + np.asarray(origin)
    return float(np.linalg.norm(found.result.corrected.position_m - optimum, axis=1).max())


_fold_graph = jax.jit(fold_graph, static_argnames="options")
_solve_graph = jax.jit(solve_graph, static_argnums=(1, 2))


def latencies(runs: list[Replayed], from_pose: int) -> dict[str, Any]:
    """Quantiles over all runs, in milliseconds; anchors that came from that pose on and were solved."""
    anchor = np.concatenate([_anchor_s(run, run.latency_s["anchor"], from_pose) for run in runs])
    processor = np.concatenate([_anchor_s(run, run.anchor_processor_s, from_pose) for run in runs])
    found: dict[str, Any] = {"anchors": len(anchor)}
    by_kind = {"anchor": anchor, "anchor_processor": processor} | {
        kind: np.concatenate([run.latency_s[kind] for run in runs]) for kind in ("odometry", "current", "sighting")
    }
    for kind, times in by_kind.items():
        p50, p99, most = (float(t) for t in 1e3 * np.percentile(times, [50, 99, 100]))
        found |= {f"{kind}_p50_ms": p50, f"{kind}_p99_ms": p99, f"{kind}_max_ms": most}
    by_run = [_anchor_s(run, run.latency_s["anchor"], from_pose) for run in runs]
    return found | {"anchor_p99_ms_by_run": [float(1e3 * np.percentile(times, 99)) for times in by_run]}


def _anchor_s(run: Replayed, times_s: np.ndarray, from_pose: int) -> np.ndarray:
    """Of the updates' times those that solved, of the poses from `from_pose` on."""
    came = np.flatnonzero(np.diff(run.n_anchors, prepend=0))
    solved = np.array([run.status[i] == "georeferenced" for i in came]) & (came >= from_pose)
    return times_s[solved]


def measure(runs: int) -> dict[str, Any]:
    """Everything; the flat keys are the figures to quote, of white noise."""
    load_before = os.getloadavg()
    rows: dict[str, Any] = {}
    for name, noise in NOISES.items():
        cases = [simulated(noise, seed) for seed in range(runs)]
        found = [run_once(case) for case in cases]
        rows[f"simulated, {name}"] = latencies(found, POSES - LAST_POSES) | {
            "poses": POSES,
            "final_difference_m": max(map(final_difference_m, cases, found)),
            "final_from_optimum_m": _largest(map(final_from_optimum_m, cases, found)),
        }
    for name in CONFIGS:
        case = recorded(name)
        found = [run_once(case) for _ in range(REAL_RUNS)]
        rows[name] = latencies(found, 0) | {
            "poses": len(case.trajectory),
            "final_difference_m": final_difference_m(case, found[-1]),
            "final_from_optimum_m": final_from_optimum_m(case, found[-1]),
        }
    quoted = rows["simulated, white"]
    return {
        "online_anchor_p99_ms": quoted["anchor_p99_ms"],
        "online_anchor_p50_ms": quoted["anchor_p50_ms"],
        "online_anchor_max_ms": quoted["anchor_max_ms"],
        "online_anchor_processor_p50_ms": quoted["anchor_processor_p50_ms"],
        "online_anchor_processor_p99_ms": quoted["anchor_processor_p99_ms"],
        "online_odometry_p99_ms": quoted["odometry_p99_ms"],
        "online_final_difference_m": max(row["final_difference_m"] for row in rows.values()),
        "online_final_from_optimum_m": _largest(row["final_from_optimum_m"] for row in rows.values()),
        "cases": rows,
        "machine": {
            "device": device_words(),
            "load_before": load_before,
            "load_after": os.getloadavg(),
        },
    }


def _largest(values: Iterable[float | None]) -> float | None:
    """Of those that are there: an ensemble has no one optimum."""
    return max((value for value in values if value is not None), default=None)


_ANCHOR_KEYS = (
    *("anchor_p50_ms", "anchor_p99_ms", "anchor_max_ms"),
    *("anchor_processor_p50_ms", "anchor_processor_p99_ms"),
)


def print_table(found: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    heads = (
        *("case", "poses", "anchors", "anchor p50", "p99", "max", "processor p50", "p99"),
        *("odometry p99", "current p99", "end - batch", "end - optimum"),
    )
    table = Table(*heads, title="Online: milliseconds")
    for name, row in found["cases"].items():
        times = (f"{row[key]:.1f}" for key in _ANCHOR_KEYS)
        pushes = (f"{row[key]:.3f}" for key in ("odometry_p99_ms", "current_p99_ms"))
        difference = f"{1e3 * row['final_difference_m']:.2g} mm"
        optimum = row["final_from_optimum_m"]
        apart = "" if optimum is None else f"{1e3 * optimum:.2g} mm"
        table.add_row(name, str(row["poses"]), str(row["anchors"]), *times, *pushes, difference, apart)
    console = Console()
    console.print(table)
    machine = found["machine"]
    loads = " to ".join(f"{machine[key][0]:.1f}" for key in ("load_before", "load_after"))
    console.print(f"{machine['device']}, load {loads}", highlight=False)


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object instead of a table."),
    runs: int = typer.Option(RUNS, help="Simulated runs of each noise."),
) -> None:
    enable_compilation_cache()
    found = measure(runs)
    print(json.dumps(found)) if as_json else print_table(found)


if __name__ == "__main__":
    sys.exit(typer.run(main))
