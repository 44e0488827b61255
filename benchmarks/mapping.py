"""LiDAR odometry, dense mapping and pose graphs on real recordings, and two simulated sessions compared.

    python -m benchmarks.mapping [--json] [--sessions DIR]

The two sessions are simulated, rendered to files, and run as a user would (`simulate-sensors`, `run`, `compare`);
a folder keeps them for the next time. Everything else is real: hku1 and its loop-closed reference, KITTI 00's first
scans, 7-Scenes, and the g2o graphs beside GTSAM.
"""

import argparse
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.graphs import graph_rows
from benchmarks.rgbd_fusion import rgbd_median_m
from eval.reference import absolute_error
from jaxgeo.cli.main import main as jaxgeo
from jaxgeo.data import Scan, Trajectory
from jaxgeo.geometry import rigid
from jaxgeo.geometry.rigid import parts, trajectory_matrices
from jaxgeo.io.scans.source import open_scans
from jaxgeo.mapping.dense_map import build_map
from jaxgeo.odometry.lidar_odometry import Odometry, estimate_odometry

ROOT = Path(__file__).resolve().parents[1]


def hku1(data: Path) -> dict[str, Any]:
    """Odometry from the raw scans alone, default settings, then mapping; RMSE of positions after one SE(3) fit."""
    path = data / "lidar" / "hku1.npz"
    with np.load(path) as packed:
        reference = trajectory_of(packed["times"], packed["optimized_poses"])
    scans = open_scans(path)
    estimate_odometry(_first(scans, 20))  # warm
    odometry = estimate_odometry(scans)
    mapped = build_map(odometry.trajectory, scans=scans)
    worse = spoiled(odometry.trajectory)
    return {
        "hku1_rmse_m": rmse_m(odometry.trajectory, reference),
        "hku1_mapped_rmse_m": rmse_m(mapped.trajectory, reference),
        "hku1_ms_per_scan": 1e3 * float(odometry.seconds.mean()),
        "hku1_period_ms": 1e3 * float(np.median(np.diff(odometry.trajectory.stamp_s))),
        "hku1_closures_accepted": int(mapped.accepted.sum()),
        "hku1_spoiled_rmse_m": rmse_m(worse, reference),
        "hku1_spoiled_mapped_rmse_m": rmse_m(build_map(worse, scans=scans).trajectory, reference),
    }


def spoiled(trajectory: Trajectory, yaw_rad: float = np.radians(10.0), along_m: float = 2.0) -> Trajectory:
    """The same odometry, turning too far and going too far, evenly along its way."""
    T = trajectory_matrices(trajectory)
    steps = rigid.inverse(T[:-1]) @ T[1:]
    share = np.linalg.norm(steps[:, :3, 3], axis=1)
    share /= share.sum()
    extra = np.zeros((len(steps), 6))
    extra[:, 0], extra[:, 5] = along_m * share, yaw_rad * share
    poses = [T[0]]
    for step in steps @ rigid.exp(extra):
        poses.append(poses[-1] @ step)
    return Trajectory(trajectory.stamp_s, *parts(np.stack(poses)))


def kitti16(data: Path) -> dict[str, Any]:
    """Error of the whole stretch's motion over its length, against the true poses."""
    path = data / "lidar" / "kitti00_first16" / "scans_voxel10cm.npz"
    with np.load(path) as packed:
        T_cam_velo = np.vstack([packed["Tr_velo_to_cam"], [0.0, 0.0, 0.0, 1.0]])
        cam = np.concatenate(
            [packed["gt_cam0_poses"], np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(packed["times"]), 1, 4))], axis=1
        )
    truth = np.linalg.inv(T_cam_velo) @ cam @ T_cam_velo
    found = estimate_odometry(open_scans(path))
    return {"kitti16_relative_error": relative_error(found, truth)}


def relative_error(found: Odometry, truth: Float[np.ndarray, "n 4 4"]) -> float:
    """Distance between the last pose as estimated and as true, both from the first pose, over the path's length."""
    T = trajectory_matrices(found.trajectory)
    estimated, true = (np.linalg.inv(poses[0]) @ poses[-1] for poses in (T, truth))
    path_m = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum()
    return float(np.linalg.norm(estimated[:3, 3] - true[:3, 3]) / path_m)


def sessions(folder: Path) -> dict[str, Any]:
    """Both simulated sessions, from scans and images to clouds; simulated data."""
    configs = [folder / name / "config.yaml" for name in ("uav", "ugv")]
    if not all(config.exists() for config in configs):
        run("simulate-sensors", "--out", str(folder), "--session", "both", "--quiet")
    for config in configs:
        run("run", str(config), "--out", str(folder / "out" / config.parent.name), "--quiet")
    first, second = (str(folder / "out" / config.parent.name) for config in configs)
    out = folder / "out" / "compare"
    run("compare", first, second, "--out", str(out), "--quiet")
    compared = json.loads((out / "compare.json").read_text())["distances"]["uav to ugv"]
    rows: dict[str, Any] = {
        "cross_session_median_m": compared["median_m"],
        "cross_session_mean_m": compared["mean_m"],
        "cross_session_within_30cm": compared["share_within_30cm"],
    }
    for session, where in (("uav", first), ("ugv", second)):
        for name, t in json.loads((Path(where) / "metrics.json").read_text())["trajectories"].items():
            loo = t["loo"]["learned"]
            rows[f"{session}_{name}_held_out_mean_m"] = loo["mean_m"]
            rows[f"{session}_{name}_revisit_m"] = {k: v for k, v in t["revisit"]["A"].items()}
    return rows


def run(*arguments: str) -> None:
    """One command of jaxgeo, which must succeed."""
    code = jaxgeo(arguments)
    if code:
        raise SystemExit(f"jaxgeo {' '.join(arguments)}: exit code {code}")


def rmse_m(estimate: Trajectory, reference: Trajectory) -> float:
    """Root mean square distance of positions after one rigid fit."""
    return absolute_error(estimate, reference, align="se3").ate_rmse_m


def trajectory_of(stamp_s: Float[np.ndarray, "n"], poses: Float[np.ndarray, "n 3 4"]) -> Trajectory:
    """Stamped poses of a packed file."""
    last = np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(poses), 1, 4))
    return Trajectory(stamp_s, *parts(np.concatenate([poses, last], axis=1)))


def _first(scans: Any, count: int) -> list[Scan]:
    return [scan for scan, _ in zip(scans, range(count), strict=False)]


def measured(data: Path, folder: Path | None) -> dict[str, Any]:
    """Every figure."""
    rows = hku1(data) | kitti16(data) | {"rgbd_median_m": rgbd_median_m(data / "rgbd_7scenes_redkitchen")}
    if folder is not None:
        rows |= sessions(folder)
    else:
        with tempfile.TemporaryDirectory() as temporary:
            rows |= sessions(Path(temporary))
    for name, row in graph_rows()["graphs"].items():
        rows[name] = {**row["runs"][0], **row}  # cost and seconds of the first start; all starts beside them
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--sessions", type=Path, help="folder that keeps the simulated sessions")
    arguments = parser.parse_args()
    rows = measured(Path(os.environ.get("JAXGEO_DATA", ROOT.parent / "shared" / "data")), arguments.sessions)
    if arguments.json:
        print(json.dumps(rows, indent=2))
    else:
        for name, value in rows.items():
            print(f"{name:40} {value}")


if __name__ == "__main__":
    main()
