"""Databases as a whole: round trips, sessions, graphs; the real ones."""

from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from rtabmap_database import SmallDatabase
from scipy.spatial.transform import Rotation

from jaxgeo.errors import TrajectoryError
from jaxgeo.io.rtabmap.database import open_rtabmap
from jaxgeo.io.rtabmap.links import KINDS


def pose(x: float, yaw: float = 0.0) -> np.ndarray:
    return np.column_stack([Rotation.from_euler("z", yaw).as_matrix(), [x, 0.0, 0.0]])


def moved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    square = np.vstack([a, [0, 0, 0, 1]]) @ np.vstack([b, [0, 0, 0, 1]])
    return square[:3]


def test_nodes_read_back(tmp_path: Path) -> None:
    gps = np.array([1700.0, 6.13, 49.61, 300.0, 2.5, 90.0])
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(3, pose(3.0, 0.5), stamp=13.5)
        small.node(1, pose(1.0), stamp=11, ground_truth_pose=pose(7.0), gps=gps.tobytes())
        small.node(2, None, stamp=12.25)
        small.node(4, pose(9.0), weight=-9)
    with open_rtabmap(tmp_path / "a.db") as database:
        assert database.version == (0, 21, 1)
        assert database.nodes.id.tolist() == [1, 2, 3]
        np.testing.assert_array_equal(database.nodes.gps[0], gps)
        assert np.isnan(database.nodes.gps[1:]).all()
        odometry = database.odometry()[0]
        assert odometry.stamp_s.tolist() == [11, 13.5]
        np.testing.assert_allclose(odometry.position_m, [[1, 0, 0], [3, 0, 0]])
        np.testing.assert_allclose(odometry.quat_wxyz[1], [np.cos(0.25), 0, 0, np.sin(0.25)], atol=1e-7)
        truth = database.truth()
        assert truth is not None
        assert truth.position_m.tolist() == [[7, 0, 0]]
        assert database.optimised() is None
        assert database.left_out.count == {"nodes": 1}


def test_sessions_keep_their_own_odometry(tmp_path: Path) -> None:
    with SmallDatabase(tmp_path / "a.db") as small:
        for node in (1, 2, 3):
            small.node(node, pose(node), map_id=0)
        for node in (4, 5):
            small.node(node, pose(node - 4), map_id=1)
    with open_rtabmap(tmp_path / "a.db") as database:
        by_session = database.odometry()
        assert {session: len(trajectory) for session, trajectory in by_session.items()} == {0: 3, 1: 2}
        assert by_session[1].position_m[:, 0].tolist() == [0, 1]
        assert database.graph().map_id.tolist() == [0, 0, 0, 1, 1]


def test_best_poses_are_in_one_frame(tmp_path: Path) -> None:
    """Nodes that were not optimised are carried by odometry; a session without any optimised node has no place."""
    to_map = moved(pose(100.0), pose(0.0, 1.0))
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1, pose(0.0), map_id=1)
        for node in range(2, 7):
            small.node(node, pose(node, 0.1 * node), map_id=0)
        small.link(5, 6, 0, moved(pose(1), pose(0)))
        small.link(6, 1, 1)
        known = [moved(to_map, pose(3, 0.3)), moved(to_map, pose(4, 0.4))]
        small.optimised([3, 4, -7, 40], np.array([*known, pose(1), pose(1)]))
    with open_rtabmap(tmp_path / "a.db") as database:
        optimised = database.optimised()
        assert optimised is not None
        assert optimised.stamp_s.tolist() == [103, 104]
        graph = database.graph()
        assert graph.id.tolist() == [2, 3, 4, 5, 6]
        assert graph.optimised.tolist() == [False, True, True, False, False]
        expected = np.array([moved(to_map, pose(n, 0.1 * n)) for n in range(2, 7)])
        np.testing.assert_allclose(graph.position_m, expected[:, :, 3], atol=2e-5)
        R = Rotation.from_quat(graph.quat_wxyz, scalar_first=True).as_matrix()
        np.testing.assert_allclose(R, expected[:, :, :3], atol=1e-6)
        assert (graph.relative.first.tolist(), graph.relative.second.tolist()) == ([3], [4])
        assert database.left_out.count == {
            "optimised landmarks": 1,
            "optimised poses": 1,
            "nodes of the graph": 1,
            "links": 1,
        }


def test_links_are_told_once_and_by_kind(tmp_path: Path) -> None:
    information = np.diag([1.0, 2, 3, 4, 5, 6])
    with SmallDatabase(tmp_path / "a.db") as small:
        for node in (10, 20, 30):
            small.node(node, pose(node))
        small.link(10, 20, 0, pose(10.0, 0.5), information)
        small.link(20, 10, 0, pose(-10.0, -0.5), information)  # the same from the other end
        small.link(20, 30, 0, pose(10.0))
        small.link(30, 10, 1, pose(-20.0))
        small.link(10, 30, 5)  # virtual
        small.link(10, 10, 7)  # prior
        small.link(10, -1, 8)  # landmark
        small.link(10, 10, 9)  # gravity
        small.link(10, 99, 0)
        small.link(20, 30, 2, None)
        small.link(20, 30, 3, pose(1), -np.eye(6))
        small.link(20, 30, 4, pose(1), np.full((6, 6), np.nan))
        small.link(10, 30, 17)
    with open_rtabmap(tmp_path / "a.db") as database:
        links = database.links
        assert [KINDS[kind] for kind in links.kind] == ["neighbour", "neighbour", "global_closure"]
        assert links.relative.first.tolist() == [0, 1, 2]
        assert links.relative.second.tolist() == [1, 2, 0]
        np.testing.assert_allclose(links.relative.t_m[:, 0], [10, 10, -20])
        np.testing.assert_allclose(links.relative.quat_wxyz[0], [np.cos(0.25), 0, 0, np.sin(0.25)], atol=1e-7)
        np.testing.assert_array_equal(links.relative.information[0], information)
        assert database.left_out.count == {
            "virtual_closure links": 1,
            "pose_prior links": 1,
            "landmark links": 1,
            "gravity links": 1,
            "type_17 links": 1,
            "links": 4,
        }
        assert "node 99 is not there" in database.left_out.first["links"]


def test_one_stamp_for_two_nodes(tmp_path: Path) -> None:
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1, stamp=5.0)
        small.node(2, stamp=5.0)
    with open_rtabmap(tmp_path / "a.db") as database, pytest.raises(TrajectoryError, match="nodes 1 and 2 have the st"):
        database.odometry()


def test_the_real_database() -> None:
    with open_rtabmap(data_root() / "rtabmap/henryoon_1node_v0.21.1.db") as database:
        assert database.version == (0, 21, 1)
        odometry, optimised, rig = database.odometry()[0], database.optimised(), database.rig()
        (frame,) = database.frames()
        assert list(database.scans()) == []
        assert database.truth() is None
        assert database.left_out.count == {}
    sample = np.loadtxt(data_root() / "rtabmap/samples/rtabmap_raw_from_db.txt").reshape(3, 4)
    assert optimised is not None
    np.testing.assert_allclose(optimised.position_m[0], sample[:, 3], atol=6e-7)
    np.testing.assert_allclose(odometry.position_m[0], sample[:, 3], atol=6e-7)
    R = Rotation.from_quat(optimised.quat_wxyz[0], scalar_first=True).as_matrix()
    np.testing.assert_allclose(R, sample[:, :3], atol=1.1e-6)
    assert odometry.stamp_s[0] == pytest.approx(1702296897.425, abs=2e-5)
    assert frame.image.shape == (720, 1280, 3)
    assert frame.depth_m.shape == (720, 1280)
    assert 0.9 < np.median(frame.depth_m[frame.depth_m > 0]) < 1.2
    assert rig is not None
    camera = rig.cameras["cam0"]
    assert camera.intrinsics_px[0] == pytest.approx(639.25, abs=0.01)
    assert camera.resolution_px == (1280, 720)
    # The local transform is of the optical axes: the camera's z is the body's x, its x the body's -y
    R_body_cam = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(R_body_cam, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=2e-3)


def test_a_real_database_without_nodes() -> None:
    with open_rtabmap(data_root() / "rtabmap/empty_v0.20.18.db") as database:
        assert len(database.nodes) == 0
        assert database.odometry() == {}
        assert database.rig() is None
        assert list(database.frames()) == []
        assert len(database.graph().id) == 0
