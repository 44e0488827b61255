from pathlib import Path

import gtsam
import numpy as np
import pytest
from data_root import data_root

from jaxgeo.errors import TrajectoryError
from jaxgeo.io import read_g2o_poses

GRAPH = """PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 7 3 0 0 0 0 1 0
VERTEX_SE3:QUAT 5 1 0 0 0 0 0 1
VERTEX_SE3:QUAT 6989586621679009793 9 0 0 0 0 0 1
VERTEX_SE3:QUAT 6989586621679009792 8 0 0 0 0 0 1
FIX 5
VERTEX_TRACKXYZ 99 1 1 1
EDGE_SE3:QUAT 5 7 2 0 0 0 0 1 0 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1
"""


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "graph.g2o"
    path.write_text(text)
    return path


def test_reads_what_gtsam_reads() -> None:
    path = data_root() / "g2o/parking-garage.g2o"
    ours = read_g2o_poses(path, rate_hz=1.0)
    _, values = gtsam.readG2o(str(path), True)
    for i in (0, 1, 800, 1660):
        pose = values.atPose3(i)
        np.testing.assert_allclose(ours.position_m[i], pose.translation(), rtol=1e-15)
        w, x, y, z = ours.quat_wxyz[i]
        np.testing.assert_allclose(gtsam.Rot3.Quaternion(w, x, y, z).matrix(), pose.rotation().matrix(), atol=1e-6)


def test_poses_come_in_the_order_of_their_ids(tmp_path: Path) -> None:
    read = read_g2o_poses(write(tmp_path, GRAPH), rate_hz=2.0)
    assert read.position_m[:, 0].tolist() == [1, 3, 8, 9]
    assert read.quat_wxyz[1].tolist() == [0, 0, 0, 1]
    assert read.stamp_s.tolist() == [0, 0.5, 1, 1.5]


def test_landmarks_of_rtabmap_are_no_poses(tmp_path: Path) -> None:
    landmark = "VERTEX_SE3:QUAT 6989586621679009800 4 4 4 0 0 0 1\nEDGE_SE3 5 6989586621679009800 0 0 0 0 0 0 1\n"
    read = read_g2o_poses(write(tmp_path, GRAPH + landmark), rate_hz=2.0)
    assert read.position_m[:, 0].tolist() == [1, 3, 8, 9]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GRAPH + "VERTEX_SE3:QUAT 5 1 0 0 0 0 0 1\n", r"graph\.g2o:9: vertex 5 repeats line 3"),
        (GRAPH.replace("QUAT 7", "QUAT x7"), r"graph\.g2o:2: vertex id 'x7', expected a whole number"),
        ("VERTEX_SE2 0 1 2 3\nVERTEX_SE2 1 1 2 3\n", r"no VERTEX_SE3:QUAT record; found VERTEX_SE2 \(2\)"),
        (GRAPH + "EDGE_SE3 5\n", r"graph\.g2o:9: 'EDGE_SE3 5', expected EDGE_SE3 followed by two vertex ids"),
    ],
)
def test_bad_graphs(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        read_g2o_poses(write(tmp_path, text), rate_hz=1.0)
