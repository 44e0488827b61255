from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

from jaxgeo.errors import TrajectoryError
from jaxgeo.io import RoundedInputWarning, read_kitti, write_kitti

IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0\n"


@pytest.mark.parametrize("name", ["kitti/est_online/06.txt", "mulran/est/KAIST_01.txt"])
def test_reads_what_evo_reads(name: str) -> None:
    ours, evo = read_kitti(data_root() / name, rate_hz=10.0), file_interface.read_kitti_poses_file(data_root() / name)
    np.testing.assert_array_equal(ours.position_m, evo.positions_xyz)
    matrix = Rotation.from_quat(ours.quat_wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrix, [pose[:3, :3] for pose in evo.poses_se3], atol=2e-6)


def test_rounded_rotations_become_the_nearest_ones() -> None:
    path = data_root() / "mulran/est/KAIST_01.txt"
    read = Rotation.from_quat(read_kitti(path, rate_hz=10.0).quat_wxyz, scalar_first=True).as_matrix()
    u, _, vt = np.linalg.svd(np.loadtxt(path).reshape(-1, 3, 4)[:, :, :3])
    np.testing.assert_allclose(read, u @ vt, atol=1e-14)


def test_stamps_from_a_file() -> None:
    folder = data_root() / "kitti"
    trajectory = read_kitti(folder / "gt/06.txt", times=folder / "times_06.txt")
    np.testing.assert_array_equal(trajectory.stamp_s, np.loadtxt(folder / "times_06.txt"))


def test_stamps_are_written_beside(tmp_path: Path) -> None:
    read = read_kitti(data_root() / "kitti/gt/06.txt", times=data_root() / "kitti/times_06.txt")
    write_kitti(tmp_path / "poses", read, times=tmp_path / "times")
    again = read_kitti(tmp_path / "poses", times=tmp_path / "times")
    np.testing.assert_array_equal(again.stamp_s, read.stamp_s)


def test_counts_that_differ_name_both() -> None:
    folder = data_root() / "kitti"
    with pytest.raises(TrajectoryError, match=r"06\.txt has 1101 poses, but .*times_00\.txt has 4541 stamps"):
        read_kitti(folder / "gt/06.txt", times=folder / "times_00.txt")


def test_without_stamps_it_says_how_to_give_them(tmp_path: Path) -> None:
    path = tmp_path / "poses"
    path.write_text(IDENTITY * 2)
    with pytest.raises(
        TrajectoryError, match=r"no stamps, and neither of `times` and `rate_hz` given.*one stamp in sec"
    ):
        read_kitti(path)
    with pytest.raises(TrajectoryError, match="both of `times` and `rate_hz` given"):
        read_kitti(path, times=path, rate_hz=1.0)


@pytest.mark.parametrize("rate_hz", [0.0, -10.0, float("nan"), float("inf")])
def test_rates_that_are_none(tmp_path: Path, rate_hz: float) -> None:
    path = tmp_path / "poses"
    path.write_text(IDENTITY * 2)
    with pytest.raises(TrajectoryError, match=rf"rate_hz is {rate_hz}, expected a positive number"):
        read_kitti(path, rate_hz=rate_hz)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ("0.0\n0.1\n0.1\n", r"times:3: stamp 0\.1 repeats that of line 2"),
        ("0.0 1\n0.1 1\n0.2 1\n", "times:1: 2 columns, expected one stamp"),
        ("1e18\n2e18\n3e18\n", "times:1: stamp 1e\\+18 is not in seconds"),
    ],
)
def test_bad_times_are_named_in_their_own_file(tmp_path: Path, times: str, message: str) -> None:
    (tmp_path / "poses").write_text(IDENTITY * 3)
    (tmp_path / "times").write_text(times)
    with pytest.raises(TrajectoryError, match=message):
        read_kitti(tmp_path / "poses", times=tmp_path / "times")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 -1 0", "poses:2: R is a reflection"),
        (
            "2 0 0 0 0 2 0 0 0 0 2 0",
            r"poses:2: R R\^T is off the identity by 3, expected at most 0\.005.*without a scale",
        ),
        ("1 0 0 0 1 0 0 0 1 5 6 7", r"poses:2: R R\^T is off the identity"),  # columns instead of rows
        ("0 0 0 0 0 0 0 0 0 0 0 0", r"poses:2: R R\^T is off the identity by 1,"),
    ],
)
def test_rows_that_are_no_rotation(tmp_path: Path, row: str, message: str) -> None:
    path = tmp_path / "poses"
    path.write_text(IDENTITY + row + "\n")
    with pytest.raises(TrajectoryError, match=message):
        read_kitti(path, rate_hz=1.0)


def test_three_decimals_are_mended_and_told(tmp_path: Path) -> None:
    path = tmp_path / "poses"
    path.write_text(IDENTITY + "0.878 -0.479 0 1 0.479 0.878 0 2 0 0 1 3\n")
    with pytest.warns(RoundedInputWarning, match="few decimals"):
        read = read_kitti(path, rate_hz=1.0)
    angle = 2 * np.arctan2(read.quat_wxyz[1, 3], read.quat_wxyz[1, 0])
    np.testing.assert_allclose(angle, np.arctan2(0.479, 0.878), atol=1e-12)
