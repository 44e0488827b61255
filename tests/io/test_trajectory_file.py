"""What all trajectory formats owe: round trips, the real files, and one clear message for each kind of bad file."""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from trajectory_strategy import trajectories

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io import (
    RoundedInputWarning,
    read_trajectory,
    validated_trajectory,
    write_euroc,
    write_g2o_poses,
    write_kitti,
    write_tum,
)

WRITERS: dict[str, Callable[..., None]] = {
    "tum": write_tum,
    "euroc": write_euroc,
    "kitti": write_kitti,
    "g2o": write_g2o_poses,
}
FORMATS = tuple(WRITERS)  # written here too; the others are tested beside their readers
ROW = {
    "tum": "{stamp} {x} 2 3 0 0 0 {qw}",
    "euroc": "{stamp}000000000,{x},2,3,{qw},0,0,0",
    "kitti": "{qw} 0 0 {x} 0 1 0 2 0 0 1 3",
    "g2o": "VERTEX_SE3:QUAT {stamp} {x} 2 3 0 0 0 {qw}",
}

REAL = [
    *(("tum", f"tagslam/test_11/{name}.tum", 4500) for name in ("vio_odom", "tagslam_reference_odom")),
    ("tum", "hilti2021/hdl_graph_slam/Basement_1.txt", 1128),
    ("tum", "hilti2021/hdl_graph_slam/Campus_2.txt", 3746),
    ("tum", "hilti2021/svo2/Basement_1.txt", 1031),
    ("tum", "hilti2021/svo2/Campus_2.txt", 3705),
    ("tum", "euroc/vio_mono/MH_03.txt", 2565),
    ("tum", "formats/georeferenced.tum", 1000),
    ("tum", "formats/freiburg1_xyz-rgbdslam_drift.txt", 788),
    ("tum", "rtabmap/samples/tum_head20.txt", 19),
    ("euroc", "euroc/gt/MH03_GT.txt", 2631),
    *(("kitti", f"kitti/{kind}/00.txt", 4541) for kind in ("gt", "est_online")),
    *(("kitti", f"kitti/{kind}/05.txt", 2761) for kind in ("gt", "est_online")),
    *(("kitti", f"kitti/{kind}/06.txt", 1101) for kind in ("gt", "est_online")),
    *(("kitti", f"kitti/{kind}/07.txt", 1101) for kind in ("gt", "est_online")),
    *(("kitti", f"mulran/{kind}/KAIST_01.txt", 8226) for kind in ("gt", "est")),
    *(("kitti", f"lidar/hku1_{kind}_poses.txt", 314) for kind in ("odom", "optimized")),
    ("kitti", "rtabmap/samples/kitti_head20.txt", 20),
    ("g2o", "rtabmap/samples/g2o_se3_head.g2o", 5),
    ("g2o", "g2o/sphere2500.g2o", 2500),
    ("g2o", "g2o/parking-garage.g2o", 1661),
    ("g2o", "g2o/torus3D.g2o", 5000),
]


def stamps(format: str) -> dict[str, float]:
    return {"rate_hz": 10.0} if format in ("kitti", "g2o") else {}


def write_rows(path: Path, format: str, rows: list[dict[str, object]]) -> Path:
    path.write_text("".join(ROW[format].format(**{"x": 1, "qw": 1, **row}) + "\n" for row in rows))
    return path


@pytest.mark.parametrize("format", FORMATS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(trajectory=trajectories(), rate_hz=st.floats(0.1, 100))
def test_reading_what_was_written_changes_nothing(
    tmp_path: Path, format: str, trajectory: Trajectory, rate_hz: float
) -> None:
    path = tmp_path / "trajectory"
    WRITERS[format](path, trajectory)
    unstamped = format in ("kitti", "g2o")
    read = read_trajectory(path, format, rate_hz=rate_hz if unstamped else None)
    expected_s = np.arange(len(trajectory)) / rate_hz if unstamped else trajectory.stamp_s
    np.testing.assert_array_equal(read.stamp_s, expected_s)
    np.testing.assert_array_equal(read.position_m, trajectory.position_m)
    if format == "kitti":  # matrices do not keep the quaternion's sign, nor its last bit
        sign = np.sign(np.sum(read.quat_wxyz * trajectory.quat_wxyz, axis=1, keepdims=True))
        np.testing.assert_allclose(sign * read.quat_wxyz, trajectory.quat_wxyz, atol=5e-15, rtol=0)
    else:
        np.testing.assert_array_equal(read.quat_wxyz, trajectory.quat_wxyz)


@pytest.mark.parametrize(("format", "name", "n"), REAL)
def test_every_real_file_reads_without_a_warning(format: str, name: str, n: int) -> None:
    trajectory = read_trajectory(data_root() / name, format, **stamps(format))
    assert len(trajectory) == n
    assert trajectory.position_m.dtype == trajectory.quat_wxyz.dtype == trajectory.stamp_s.dtype == np.float64
    np.testing.assert_allclose(np.linalg.norm(trajectory.quat_wxyz, axis=1), 1.0, atol=1e-13)


def test_the_longest_real_file_reads_fast() -> None:
    path = data_root() / "mulran/est/KAIST_01.txt"
    read_trajectory(path, "kitti", rate_hz=10.0)
    start = time.perf_counter()
    read_trajectory(path, "kitti", rate_hz=10.0)
    assert time.perf_counter() - start < 0.2


def test_four_decimals_are_mended_and_told() -> None:
    with pytest.warns(RoundedInputWarning, match=r"off by up to 8\.4e-05.*few decimals"):
        trajectory = read_trajectory(data_root() / "formats/freiburg1_xyz-groundtruth.txt", "tum")
    np.testing.assert_allclose(np.linalg.norm(trajectory.quat_wxyz, axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("format", FORMATS)
def test_one_pose_is_not_a_trajectory(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}])
    with pytest.raises(TrajectoryError, match=r"t: 1 pose\(s\), expected at least 2"):
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("value", ["nan", "inf", "1e999"])
def test_numbers_that_are_not_finite_name_their_line(tmp_path: Path, format: str, value: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "x": value}])
    with pytest.raises(TrajectoryError, match=rf"t:2: column .* holds '{value}'; expected a finite number"):
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", FORMATS)
def test_text_among_the_numbers_names_line_and_column(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "x": "oops"}])
    with pytest.raises(TrajectoryError, match=r"t:2: column \d .* holds 'oops'; expected a number"):
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", FORMATS)
def test_a_row_cut_short_names_both_counts(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1}])
    path.write_text(path.read_text()[:-3].rstrip(" ,") + "\n")
    with pytest.raises(TrajectoryError, match=r"t:2: (7|8|11) columns, expected (8|9|12) as in line 1"):
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", FORMATS)
def test_a_foreign_table_names_the_columns_expected(tmp_path: Path, format: str) -> None:
    path = tmp_path / "t"
    path.write_text("VERTEX_SE3:QUAT 1 2\nVERTEX_SE3:QUAT 2 2\n" if format == "g2o" else "1 2 3\n4 5 6\n")
    with pytest.raises(TrajectoryError, match=r"t:1: 3 (columns|fields), expected the (8|9|12)"):
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", FORMATS)
def test_huge_positions_are_refused(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "x": -2e9}])
    with pytest.raises(TrajectoryError, match=r"t:2: coordinate -2e\+09 m is beyond"):
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", ["tum", "euroc"])
def test_unsorted_stamps_name_both_stamps(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 5}, {"stamp": 7}, {"stamp": 6}])
    with pytest.raises(TrajectoryError, match=r"t:3: stamp 6\.0 lies before 7\.0 of line 2; .* Sort the rows"):
        read_trajectory(path, format)


@pytest.mark.parametrize("format", ["tum", "euroc"])
def test_repeated_stamps_say_how_to_mend(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 5}, {"stamp": 7}, {"stamp": 7}])
    with pytest.raises(TrajectoryError, match=r"t:3: stamp 7\.0 repeats that of line 2; .* Keep one"):
        read_trajectory(path, format)


@pytest.mark.parametrize("format", ["tum", "euroc", "g2o"])
def test_quaternion_norms(tmp_path: Path, format: str) -> None:
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "qw": 0.7}])
    with pytest.raises(TrajectoryError, match=r"t:2: the quaternion has norm 0\.7, expected 1 within 0\.001"):
        read_trajectory(path, format, **stamps(format))
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "qw": 0}])
    with pytest.raises(TrajectoryError, match=r"t:2: the quaternion is zero.*columns in another order"):
        read_trajectory(path, format, **stamps(format))
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "qw": 0.9995}])
    with pytest.warns(RoundedInputWarning, match=r"off by up to 5\.0e-04"):
        assert read_trajectory(path, format, **stamps(format)).quat_wxyz[1, 0] == 1.0
    path = write_rows(tmp_path / "t", format, [{"stamp": 0}, {"stamp": 1, "qw": 0.999999}])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_trajectory(path, format, **stamps(format))


@pytest.mark.parametrize("format", FORMATS)
def test_a_file_that_is_not_there(tmp_path: Path, format: str) -> None:
    with pytest.raises(TrajectoryError, match=r"gone\.txt: no such file"):
        read_trajectory(tmp_path / "gone.txt", format, **stamps(format))
    with pytest.raises(TrajectoryError, match="is a folder, expected a text file"):
        read_trajectory(tmp_path, format, **stamps(format))


def test_unknown_format_lists_the_known() -> None:
    with pytest.raises(
        TrajectoryError,
        match="unknown trajectory format 'csv', expected one of tum, euroc, kitti, g2o, npy, tum-index, rtabmap, ",
    ):
        read_trajectory("t.csv", "csv")


def test_stamps_cannot_be_given_twice() -> None:
    with pytest.raises(TrajectoryError, match="format tum has its own stamps"):
        read_trajectory("t.tum", "tum", rate_hz=10.0)


def test_rows_from_elsewhere_are_checked_too() -> None:
    line = np.array([4, 9])
    with pytest.raises(TrajectoryError, match="bag:9: holds nan; expected finite numbers"):
        validated_trajectory("bag", line, np.array([0.0, 1.0]), np.array([[0, 0, 0], [0, np.nan, 0]]), np.eye(4)[:2])
