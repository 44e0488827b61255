"""Learned noise against whole true trajectories: `python -m benchmarks.layouts [--json]`.

Seven visits of one layout say little. Here many anchor layouts are drawn along real LiDAR odometry (KITTI 00 05 06 07,
MulRan KAIST_01): 5 to 11 locations at random on a random stretch of the path, one of them visited twice where the path
passes it again, surveyed to a centimetre. Each is corrected with all its anchors, and the error is that of every pose
between the first and the last anchor against the data set's truth.
"""

import json
import os
import warnings
from pathlib import Path

import numpy as np
import typer
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from calibration.calibrate import LearnSettings, calibrate_and_correct
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import EstimationError
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.io import InputWarning
from jaxgeo.io.kitti import read_kitti
from jaxgeo.precision import enable_compilation_cache
from jaxgeo.solve.correct import Settings, correct

ROOT = Path(__file__).resolve().parents[1]
SEQUENCES = {
    **{f"kitti{s}": (f"kitti/est_online/{s}.txt", f"kitti/gt/{s}.txt") for s in ("00", "05", "06", "07")},
    "mulran_kaist01": ("mulran/est/KAIST_01.txt", "mulran/gt/KAIST_01.txt"),
}
KIND = "lidar"
RATE_HZ = 10.0
SIGMA_M = 0.01
# A second visit: within this distance of the first, and this much earlier or later along the path.
NEAR_M, APART_M = 5.0, 50.0
# Of the locations' middle to their largest extent: narrower layouts hardly fix the frame.
LEAST_WIDTH = 0.15


def draw_rows(
    truth_m: Float[np.ndarray, "n 3"], random: np.random.Generator
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Rows of the visits, in order, and the location of each: a revisit sees the location of its first visit."""
    path_m = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(truth_m, axis=0), axis=1))]
    while True:
        first = random.uniform(0.0, 0.5) * path_m[-1]
        last = first + random.uniform(0.3, 1.0) * (path_m[-1] - first)
        rows = np.unique(np.searchsorted(path_m, np.sort(random.uniform(first, last, random.integers(5, 12)))))
        extent = np.linalg.svd(truth_m[rows] - truth_m[rows].mean(axis=0), compute_uv=False)
        if len(rows) >= 5 and extent[1] > LEAST_WIDTH * extent[0]:
            break
    again = []
    for location, row in enumerate(rows):
        apart = (np.abs(path_m - path_m[row]) > APART_M) & (path_m >= first) & (path_m <= last)
        distance_m = np.where(apart, np.linalg.norm(truth_m - truth_m[row], axis=1), np.inf)
        if distance_m.min() < NEAR_M:
            again.append((int(np.argmin(distance_m)), location))
    visits = [(int(row), location) for location, row in enumerate(rows)]
    if again:
        visits.append(again[random.integers(len(again))])
    visits.sort()
    return np.array([row for row, _ in visits]), np.array([location for _, location in visits])


def anchors_at(
    truth: Trajectory, rows: Int[np.ndarray, "k"], location: Int[np.ndarray, "k"], origin_m: Float[np.ndarray, "3"]
) -> Anchors:
    """Exact anchors that claim a centimetre: each location where the truth is at its first row."""
    k = len(rows)
    _, first, index = np.unique(location, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    surveyed = truth.position_m[rows[first]][index]
    arm = Rotation.from_quat(truth.quat_wxyz[rows], scalar_first=True).inv().apply(surveyed - truth.position_m[rows])
    nothing = np.full((k, 4), np.nan)
    covariance = np.broadcast_to(SIGMA_M**2 * np.eye(3), (k, 3, 3))
    return Anchors(
        label=tuple(f"visit {i}" for i in range(k)),
        location=tuple(f"location {i}" for i in index),
        location_index=order[index],
        pose_index=rows,
        lever_arm_m=arm,
        lever_covariance_m2=covariance,
        surveyed_enh_m=surveyed - origin_m,
        survey_covariance_m2=covariance,
        quat_body_marker_wxyz=nothing,
        quat_grid_marker_wxyz=nothing,
        rotation_covariance_rad2=np.zeros((k, 3, 3)),
        repeatability_m=np.zeros(k),
        count=np.ones(k, dtype=int),
        stamp_s=truth.stamp_s[rows],
    )


def errors_of(odometry: Trajectory, truth: Trajectory, random: np.random.Generator) -> dict[str, float] | None:
    """RMSE of the positions between the first and the last anchor; None where the anchors do not fix the frame."""
    rows, location = draw_rows(truth.position_m, random)
    origin_m = truth.position_m[rows].mean(axis=0).round()
    anchors = anchors_at(truth, rows, location, origin_m)
    noise, settings = default_noise(KIND), Settings()
    try:
        fixed = correct(odometry, anchors, noise, settings)
        _, learned, _ = calibrate_and_correct(
            odometry, anchors, settings, LearnSettings(KIND, noise), np.zeros((0, len(anchors)))
        )
    except EstimationError:
        return None
    between = slice(rows[0], rows[-1] + 1)

    def rmse_m(found: Trajectory) -> float:
        off = found.position_m[between] + origin_m - truth.position_m[between]
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))

    return {
        "similarity_m": rmse_m(fixed.coarse),
        "fixed_m": rmse_m(fixed.corrected),
        "learned_m": rmse_m(learned.corrected),
    }


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    draws: int = typer.Option(16, help="Layouts per sequence."),
    seed: int = typer.Option(0, help="Of the layouts."),
) -> None:
    data = Path(os.environ.get("JAXGEO_DATA", ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    warnings.simplefilter("ignore", InputWarning)
    rows, failed = [], 0
    for name, (estimate, truth) in SEQUENCES.items():
        odometry, true = (read_kitti(data / path, rate_hz=RATE_HZ) for path in (estimate, truth))
        for i in range(draws):
            found = errors_of(odometry, true, np.random.default_rng([seed, i]))
            failed += found is None
            if found is not None:
                rows.append({"sequence": name, "layout": i, **found})
    table = np.array([[row["similarity_m"], row["fixed_m"], row["learned_m"]] for row in rows])
    ratio = np.log(table / table[:, :1])
    over_fixed = table[:, 2] / table[:, 1]
    out = {
        "layouts": len(rows),
        "failed": failed,
        "fixed_over_similarity": float(np.exp(ratio[:, 1].mean())),
        "learned_over_similarity": float(np.exp(ratio[:, 2].mean())),
        "learned_over_fixed_median": float(np.median(over_fixed)),
        "learned_over_fixed_worst": float(over_fixed.max()),
        "learned_better_than_fixed_share": float(np.mean(over_fixed < 1.0)),
        "learned_better_than_similarity_share": float(np.mean(table[:, 2] < table[:, 0])),
    }
    print(json.dumps(out | {"rows": rows}) if as_json else json.dumps(out, indent=1))


if __name__ == "__main__":
    typer.run(main)
