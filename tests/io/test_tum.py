from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from evo.tools import file_interface

from jaxgeo.errors import TrajectoryError
from jaxgeo.io import read_tum, write_tum

RTABMAP_11 = """#timestamp x y z qx qy qz qw id
10.5 1 2 3 0 0 0 1 1
11.5 1 2 4 0 0 1 0 2
0.0 7 7 7 0 0 0 1 -3
"""


@pytest.mark.parametrize("name", ["tagslam/test_11/vio_odom.tum", "hilti2021/svo2/Campus_2.txt"])
def test_reads_what_evo_reads(name: str) -> None:
    ours, evo = read_tum(data_root() / name), file_interface.read_tum_trajectory_file(data_root() / name)
    np.testing.assert_array_equal(ours.stamp_s, evo.timestamps)
    np.testing.assert_array_equal(ours.position_m, evo.positions_xyz)
    np.testing.assert_allclose(ours.quat_wxyz, evo.orientations_quat_wxyz, atol=2e-7)


def test_evo_reads_what_we_write(tmp_path: Path) -> None:
    ours = read_tum(data_root() / "formats/georeferenced.tum")
    write_tum(tmp_path / "t.tum", ours)
    evo = file_interface.read_tum_trajectory_file(tmp_path / "t.tum")
    np.testing.assert_array_equal(evo.timestamps, ours.stamp_s)
    np.testing.assert_array_equal(evo.positions_xyz, ours.position_m)


def test_grid_sized_coordinates_keep_their_digits() -> None:
    trajectory = read_tum(data_root() / "formats/georeferenced.tum")
    assert trajectory.position_m[0].tolist() == [458074.604293362994, 5429380.17209327221, 162.905919199737895]


def test_landmarks_of_rtabmap_are_no_poses(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text(RTABMAP_11)
    trajectory = read_tum(path)
    assert trajectory.stamp_s.tolist() == [10.5, 11.5]
    assert trajectory.quat_wxyz.tolist() == [[1, 0, 0, 0], [0, 0, 0, 1]]


def test_a_ninth_column_must_be_an_id(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text(RTABMAP_11.replace("0 1 0 2", "0 1 0 0.25"))
    with pytest.raises(TrajectoryError, match=r"t\.tum:3: ninth column holds 0\.25; expected a whole node id"):
        read_tum(path)


def test_nanoseconds_are_not_seconds(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text("1403637132888318976 0 0 0 0 0 0 1\n1403637132938319104 0 0 0 0 0 0 1\n")
    with pytest.raises(TrajectoryError, match=r"t\.tum:1: stamp 1\.40363713e\+18 is not in seconds.*nanoseconds"):
        read_tum(path)


@pytest.mark.parametrize("sign", ["\ufeff", "\r\n", "\t", "# stamp x y z qx qy qz qw\n", "t x y z qx qy qz qw\n"])
def test_other_ways_to_write_the_same_file(tmp_path: Path, sign: str) -> None:
    text = "0.5 1 2 3 0 0 0 1\n\n# a comment\n1.5 1 2 3 0 0 1 0\n"
    variants = {"\ufeff": sign + text, "\r\n": text.replace("\n", sign), "\t": text.replace(" ", sign)}
    path = tmp_path / "t.tum"
    path.write_bytes(variants.get(sign, sign + text).encode())
    assert read_tum(path).stamp_s.tolist() == [0.5, 1.5]
