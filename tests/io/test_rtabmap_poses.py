"""One trajectory written in every flavour, from the formulas of RTAB-Map's exporter, reads to equal poses."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from hypothesis import HealthCheck, given, settings
from scipy.spatial.transform import Rotation
from trajectory_strategy import trajectories

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io import read_trajectory
from jaxgeo.io.rtabmap.pose_export import FLAVOURS, read_rtabmap_poses

O = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # noqa: E741
W = np.array([[0.0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


def matrices(trajectory: Trajectory) -> np.ndarray:
    T = np.tile(np.eye(4), (len(trajectory), 1, 1))
    T[:, :3, :3] = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True).as_matrix()
    T[:, :3, 3] = trajectory.position_m
    return T


def write_flavour(path: Path, trajectory: Trajectory, flavour: str, digits: str = ".17g", ids: bool = False) -> None:
    T = matrices(trajectory)
    if flavour == "kitti":
        T = np.linalg.inv(O) @ T @ O
    if flavour == "rgbd-slam":
        T = np.linalg.inv(O) @ (np.linalg.inv(W) @ T) @ O
    quat_xyzw = Rotation.from_matrix(T[:, :3, :3]).as_quat()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # straight up or down: yaw and roll are not told apart, their sum is
        ypr = Rotation.from_matrix(T[:, :3, :3]).as_euler("ZYX") if flavour == "toro" else np.empty((len(T), 3))
    lines = ["#timestamp x y z qx qy qz qw" + " id" * ids] if flavour in ("tum", "rgbd-slam") else []
    for i, pose in enumerate(T):
        t, q = pose[:3, 3], quat_xyzw[i]
        numbers, start, end = [*t, *q], "", f" {i + 1}" if ids else ""
        if flavour in ("raw", "kitti"):
            numbers = pose[:3].ravel()
        elif flavour in ("tum", "rgbd-slam"):
            numbers = [trajectory.stamp_s[i], *numbers]
        elif flavour == "toro":
            numbers, start = [*t, *ypr[i][::-1]], f"VERTEX3 {i + 1} "
        else:
            start = f"VERTEX_SE3:QUAT {i + 1} "
        lines.append(start + " ".join(f"{v:{digits}}" for v in numbers) + end)
    if ids:
        lines.append("0.000000 7 7 7 0 0 0 1 -3")  # a landmark
    path.write_text("\n".join(lines) + "\n")


def times_of(path: Path, trajectory: Trajectory, flavour: str) -> Path | None:
    if flavour in ("tum", "rgbd-slam"):
        return None
    times = path.with_suffix(".times")
    times.write_text("".join(f"{s!r}\n" for s in trajectory.stamp_s.tolist()))
    return times


@pytest.mark.parametrize(("flavour", "ids"), [*((flavour, False) for flavour in FLAVOURS), ("tum", True)])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=15)
@given(trajectory=trajectories())
def test_every_flavour_reads_to_the_same_poses(tmp_path: Path, flavour: str, ids: bool, trajectory: Trajectory) -> None:
    path = tmp_path / "poses.txt"
    write_flavour(path, trajectory, flavour, ids=ids)
    read = read_trajectory(path, f"rtabmap-{flavour}", times=times_of(path, trajectory, flavour))
    np.testing.assert_allclose(read.stamp_s, trajectory.stamp_s, rtol=1e-15)
    scale = 1 + np.abs(trajectory.position_m).max()
    np.testing.assert_allclose(read.position_m, trajectory.position_m, atol=1e-14 * scale, rtol=0)
    np.testing.assert_allclose(matrices(read)[:, :3, :3], matrices(trajectory)[:, :3, :3], atol=1e-7)


def walk(n: int = 40) -> Trajectory:
    t = np.linspace(0, 4, n)
    quat = Rotation.from_euler("ZYX", np.column_stack([t, 0.1 * np.sin(t), 0.05 * t])).as_quat(scalar_first=True)
    return Trajectory(1700000000.0 + t, np.column_stack([5 * t, np.sin(t), 0.1 * t]), quat)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_six_decimals_read_without_a_warning(tmp_path: Path, flavour: str) -> None:
    path = tmp_path / "poses.txt"
    write_flavour(path, walk(), flavour, digits="f")
    read = read_rtabmap_poses(path, flavour, times=times_of(path, walk(), flavour))
    np.testing.assert_allclose(read.position_m, walk().position_m, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(read.quat_wxyz, axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize("flavour", ["toro", "g2o", "tum"])
def test_flavours_that_the_file_tells(tmp_path: Path, flavour: str) -> None:
    path = tmp_path / "poses.txt"
    write_flavour(path, walk(), flavour, ids=flavour == "tum")
    read = read_trajectory(path, "rtabmap", times=times_of(path, walk(), flavour))
    np.testing.assert_allclose(read.position_m, walk().position_m, atol=1e-12)


@pytest.mark.parametrize(
    ("flavour", "message"),
    [
        ("tum", r"8 columns are RTAB-Map's format 10 .* or 1 .*Name the flavour: tum or rgbd-slam"),
        ("rgbd-slam", r"8 columns are RTAB-Map's format 10"),
        ("raw", r"12 columns are RTAB-Map's format 0 .* or 2 .*raw or kitti"),
        ("kitti", r"12 columns"),
    ],
)
def test_flavours_that_must_be_named(tmp_path: Path, flavour: str, message: str) -> None:
    path = tmp_path / "poses.txt"
    write_flavour(path, walk(), flavour)
    with pytest.raises(TrajectoryError, match=message):
        read_rtabmap_poses(path)


def test_the_axes_of_a_forward_walk(tmp_path: Path) -> None:
    """Forward is z in KITTI's axes; in RGBD-SLAM's flavour it is O^-1 W^-1 applied to x."""
    path = tmp_path / "poses.txt"
    path.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 2\n")
    assert read_rtabmap_poses(path, "kitti", rate_hz=1).position_m[1].tolist() == [2, 0, 0]
    # As the exporter's floats: t = O^-1 W^-1 (1, 0, 0) = O^-1 (0, 0, 1) = (0, -1, 0); R = O^-1 W^-1 O
    quat = Rotation.from_matrix(np.linalg.inv(O[:3, :3]) @ np.linalg.inv(W[:3, :3]) @ O[:3, :3]).as_quat()
    q = " ".join(map(repr, quat.tolist()))
    path.write_text(f"0 0 0 0 {q}\n1 0 -1 0 {q}\n")
    read = read_rtabmap_poses(path, "rgbd-slam")
    np.testing.assert_allclose(read.position_m[1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(np.abs(read.quat_wxyz[:, 0]), 1, atol=1e-15)


def test_a_plane_graph_of_toro(tmp_path: Path) -> None:
    path = tmp_path / "p.graph"
    path.write_text("VERTEX2 -4 9 9 0\nVERTEX2 2 3 4 1.5\nVERTEX2 1 1 2 0\nEDGE2 1 2 1 1 1 1 0 0 1 0 1\n")
    read = read_rtabmap_poses(path, rate_hz=2.0)
    assert read.position_m.tolist() == [[1, 2, 0], [3, 4, 0]]
    np.testing.assert_allclose(read.quat_wxyz[1], [np.cos(0.75), 0, 0, np.sin(0.75)], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("VERTEX3 1 0 0 0 0 0 0\nVERTEX2 2 0 0 0\n", "records of both VERTEX3 and VERTEX2"),
        ("VERTEX3 1 0 0 0 0 0 0\nVERTEX3 1 0 0 1 0 0 0\n", r":2: vertex 1 repeats line 1"),
        ("VERTEX3 1 0 0 0 0\nVERTEX3 2 0 0 1 0\n", r":1: 6 fields, expected the 8"),
        ("VERTEX3 1 0 0 0 0 0 x\nVERTEX3 2 0 0 1 0 0 0\n", r":1: column 7 .* holds 'x'"),
        ("EDGE3 1 2\n", "no VERTEX3 or VERTEX2 record"),
    ],
)
def test_toro_graphs_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "p.graph"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=message):
        read_rtabmap_poses(path, "toro", rate_hz=1.0)


def test_what_cannot_be_meant(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    write_flavour(path, walk(), "tum")
    with pytest.raises(TrajectoryError, match="flavour tum has its own stamps"):
        read_rtabmap_poses(path, "tum", rate_hz=1.0)
    with pytest.raises(TrajectoryError, match="unknown flavour 'ros'"):
        read_rtabmap_poses(path, "ros")
    path.write_text("1 2 3\n")
    with pytest.raises(TrajectoryError, match="3 columns in the first row"):
        read_rtabmap_poses(path)


def test_the_sample_of_a_real_export() -> None:
    path = data_root() / "rtabmap/samples/rtabmap_raw_from_db.txt"
    with pytest.raises(TrajectoryError, match=r"1 pose\(s\), expected at least 2"):
        read_rtabmap_poses(path, "raw", rate_hz=1.0)
