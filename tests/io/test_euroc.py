from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from evo.tools import file_interface

from jaxgeo.errors import TrajectoryError
from jaxgeo.io import read_euroc, read_tum, write_euroc


def test_reads_what_evo_reads() -> None:
    path = data_root() / "euroc/gt/MH03_GT.txt"
    ours, evo = read_euroc(path), file_interface.read_euroc_csv_trajectory(path)
    np.testing.assert_allclose(ours.stamp_s, evo.timestamps, atol=5e-7, rtol=0)
    np.testing.assert_array_equal(ours.position_m, evo.positions_xyz)
    np.testing.assert_allclose(ours.quat_wxyz, evo.orientations_quat_wxyz, atol=1e-9)


def test_stamps_are_the_nearest_seconds(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("1403637132888318977,0,0,0,1,0,0,0\n1.5e18,0,0,0,1,0,0,0\n")
    assert read_euroc(path).stamp_s.tolist() == [1403637132.888318977, 1.5e9]


def test_whole_nanoseconds_are_written(tmp_path: Path) -> None:
    trajectory = read_tum(data_root() / "tagslam/test_11/vio_odom.tum")
    write_euroc(tmp_path / "t.csv", trajectory)
    first = (tmp_path / "t.csv").read_text().splitlines()[1].split(",")[0]
    assert first.isdecimal()
    assert abs(int(first) - 1541777802116735220) < 120


def test_the_long_table_reads_as_the_short(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("".join(f"{i}00000000,1,2,3,1,0,0,0{',0.5' * 9}\n" for i in (1, 2)))
    assert read_euroc(path).position_m.tolist() == [[1, 2, 3]] * 2


def test_seconds_are_not_nanoseconds(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("1403637132.88,0,0,0,1,0,0,0\n1403637132.93,0,0,0,1,0,0,0\n")
    with pytest.raises(TrajectoryError, match=r"t\.csv:1: successive stamps differ by 0\.05, expected nanoseconds"):
        read_euroc(path)
