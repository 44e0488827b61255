"""Databases as a whole: round trips, sessions, graphs; hostile files; the real ones."""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from rtabmap_database import (
    IDENTITY,
    SCHEMA,
    SmallDatabase,
    camera_blob,
    compressed,
    encoded,
    projection,
    rvl,
    scan_info_blob,
    stereo_blob,
)
from scipy.spatial.transform import Rotation

from jaxgeo.errors import GraphError, InputError, JaxgeoError, ScanError, TrajectoryError
from jaxgeo.io.rtabmap import connection
from jaxgeo.io.rtabmap import database as database_module
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


def picture(value: int, width: int = 8) -> np.ndarray:
    return np.full((6, width, 3), [value, 10, 200], np.uint8)


def test_frames_and_scans_come_one_by_one_in_order_of_time(tmp_path: Path) -> None:
    depth = np.arange(48, dtype=np.uint16).reshape(6, 8) * 100
    rows = np.array([[1, 2, 3, 50, 0.01], [4, 5, 6, 60, -0.02]], "<f4")
    with SmallDatabase(tmp_path / "a.db") as small:
        for node, stamp in ((1, 20.0), (2, 10.0), (3, 30.0), (4, 40.0)):
            small.node(node, pose(node), stamp=stamp)
        small.data(1, image=encoded(picture(1)), depth=encoded(depth), calibration=camera_blob())
        small.data(2, image=encoded(picture(2)), depth=rvl(depth), calibration=camera_blob())
        small.data(3, image=encoded(picture(3)), scan=compressed(rows, 5), scan_info=scan_info_blob(11))
        small.data(4, calibration=camera_blob(fx=12))
    with open_rtabmap(tmp_path / "a.db") as database:
        frames = database.frames()
        first = next(frames)
        assert (first.stamp_s, first.index, first.source) == (10, 0, f"{tmp_path}/a.db: node 2")
        np.testing.assert_array_equal(first.image, picture(2))
        np.testing.assert_allclose(first.depth_m, depth / 1000, rtol=1e-6)
        assert [frame.stamp_s for frame in frames] == [20]
        (scan,) = database.scans()
        assert (scan.stamp_s, scan.index) == (30, 2)
        np.testing.assert_array_equal(scan.points_m, rows[:, :3])
        assert scan.time_s is not None
        np.testing.assert_array_equal(scan.time_s, rows[:, 4])
        assert database.left_out.count == {"frames": 1, "calibrations": 1}
        assert "node 3: no depth" in database.left_out.first["frames"]


def test_several_cameras_stand_side_by_side(tmp_path: Path) -> None:
    image = np.hstack([picture(1), picture(2)])
    depth = np.hstack([np.full((3, 4), 1000), np.full((3, 4), 2000)]).astype(np.uint16)  # half the size
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1)
        small.data(1, image=encoded(image), depth=encoded(depth), calibration=camera_blob() + camera_blob(fx=20))
    with open_rtabmap(tmp_path / "a.db") as database:
        rig = database.rig()
        assert rig is not None
        assert [camera.intrinsics_px[0] for camera in rig.cameras.values()] == [10, 20]
        (frame,) = database.frames(camera=1)
        np.testing.assert_array_equal(frame.image, picture(2))
        np.testing.assert_array_equal(frame.depth_m, np.full((6, 8), 2, np.float32))


def test_stereo_has_no_depth(tmp_path: Path) -> None:
    pair = stereo_blob(camera_blob(P=projection(20)), camera_blob(P=projection(20, 0.1)))
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1)
        small.data(1, image=encoded(picture(1)), depth=encoded(picture(1)[:, :, 0]), calibration=pair)
    with open_rtabmap(tmp_path / "a.db") as database:
        with pytest.raises(ScanError, match="depth: holds the right image of a stereo camera"):
            list(database.frames())
        rig = database.rig()
        assert rig is not None
        assert len(rig.cameras) == 2


@pytest.mark.parametrize(("parameters", "rectified"), [("A:1", True), ("B:2;Rtabmap/RectifyOnlyFeatures:true", False)])
def test_whether_images_are_rectified(tmp_path: Path, parameters: str, rectified: bool) -> None:
    with SmallDatabase(tmp_path / "a.db", parameters=parameters) as small:
        small.node(1)
        small.data(1, calibration=camera_blob(P=projection(20), D=[1, 2, 3, 4]))
    with open_rtabmap(tmp_path / "a.db") as database:
        rig = database.rig()
        assert rig is not None
        assert (rig.cameras["cam0"].intrinsics_px[0] == 20) == rectified
        assert (rig.cameras["cam0"].distortion_model == "none") == rectified


BAD_BLOBS: dict[str, tuple[dict[str, object], str]] = {
    "text": ({"image": "text"}, "node 1: image: holds str 'text', expected binary data"),
    "not an image": ({"image": b"\x00" * 20}, "node 1: image: 20 bytes, beginning with 00 00"),
    "cut off": ({"image": encoded(picture(1))[:50]}, "node 1: image: 50 bytes.*are no image"),
    "other size": ({"image": encoded(picture(1, 16))}, "16 x 6 pixels, but the calibration is of 8 x 6"),
    "shape of depth": ({"depth": encoded(np.ones((6, 7), np.uint16))}, "7 x 6 pixels for an image of 8 x 6"),
    "scan cut off": ({"scan": b"12345", "scan_info": scan_info_blob(6)}, "node 1: scan: 5 bytes, too few"),
    "scan format": ({"scan": b"12345", "scan_info": scan_info_blob(77)}, "scan format 77 is not known"),
}


@pytest.mark.parametrize("name", BAD_BLOBS)
def test_a_bad_value_is_refused_or_left_out_with_its_reason(tmp_path: Path, name: str) -> None:
    blobs, message = BAD_BLOBS[name]
    depth = np.ones((6, 8), np.uint16)
    good = {"image": encoded(picture(1)), "depth": encoded(depth), "calibration": camera_blob()}
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1)
        small.node(2)
        small.data(1, **{**good, **blobs})
        small.data(2, **good, scan=compressed(np.ones((1, 4), "<f4"), 4), scan_info=scan_info_blob(6))
    with open_rtabmap(tmp_path / "a.db") as database:
        read = database.scans if "scan" in blobs else database.frames
        with pytest.raises(InputError, match=message):
            list(read())
        if name != "text":  # damaged beyond one image: the column's type is wrong
            assert [item.stamp_s for item in read(on_bad="skip")] == [102]
            (reason,) = database.left_out.first.values()
            assert reason.startswith(f"{tmp_path}/a.db: node 1")


def empty(path: Path) -> None:
    path.write_bytes(b"")


def other_kind(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))


def folder(path: Path) -> None:
    path.mkdir()


def other_schema(path: Path) -> None:
    _script(path, "CREATE TABLE songs (a); INSERT INTO songs VALUES (1);")


def view(path: Path) -> None:
    _script(path, SCHEMA.replace("CREATE TABLE Node", "CREATE TABLE Real_Node").split("CREATE TRIGGER")[0])
    _script(path, "CREATE VIEW Node AS SELECT * FROM Real_Node;")


def virtual(path: Path) -> None:
    _script(path, SCHEMA.split("CREATE TRIGGER")[0] + "DROP TABLE Link; CREATE VIRTUAL TABLE Link USING fts5(from_id);")


def computed(path: Path) -> None:
    """A column that calls a function when it is read."""
    with SmallDatabase(path) as small:
        small.run("DROP TABLE Info")
        small.run("CREATE TABLE Info (a, parameters TEXT GENERATED ALWAYS AS (hex(zeroblob(a))) VIRTUAL)")


def no_version(path: Path) -> None:
    with SmallDatabase(path) as small:
        small.run("DELETE FROM Admin")


def odd_version(path: Path) -> None:
    with SmallDatabase(path, version="; DROP") as _:
        pass


def old_version(path: Path) -> None:
    with SmallDatabase(path, version="0.11.8") as _:
        pass


def cut_off(path: Path) -> None:
    with SmallDatabase(path) as small:
        for node in range(1, 400):
            small.node(node)
    path.write_bytes(path.read_bytes()[:-9000])


def overwritten(path: Path) -> None:
    with SmallDatabase(path) as small:
        for node in range(1, 400):
            small.node(node)
    data = bytearray(path.read_bytes())
    data[4096:] = os.urandom(len(data) - 4096)
    path.write_bytes(data)


def half_written(path: Path) -> None:
    with SmallDatabase(path) as small:
        small.node(1)
    Path(f"{path}-journal").write_bytes(b"a transaction")


def _script(path: Path, script: str) -> None:
    made = sqlite3.connect(path)
    made.executescript(script)
    made.close()


def _node(**values: object) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with SmallDatabase(path) as small:
            small.node(1, **values)  # pyright: ignore[reportArgumentType]

    return make


def _optimised(ids: bytes | str | None, poses: bytes | None) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with SmallDatabase(path) as small:
            small.node(1)
            small.run("UPDATE Admin SET opt_ids = ?, opt_poses = ?", ids, poses)

    return make


def _link(*values: object) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with SmallDatabase(path) as small:
            small.node(1)
            small.node(2)
            small.link(*values)  # pyright: ignore[reportArgumentType]

    return make


IDS = compressed(np.array([[1]], "<i4"))
POSES = compressed(IDENTITY.astype("<f4").reshape(1, 12))
HOSTILE: list[tuple[Callable[[Path], None], str]] = [
    (empty, "is empty; an RTAB-Map database is an SQLite file"),
    (other_kind, "begins with b'.x89PNG.*an RTAB-Map database is an SQLite file"),
    (folder, "is a folder, expected an RTAB-Map database"),
    (other_schema, r"no table 'Admin' \(tables: songs\)"),
    (view, "'Node' is a view, expected an ordinary table.*do not trust it"),
    (virtual, "'Link' is a virtual table, expected an ordinary table"),
    (computed, "column 'parameters' of table 'Info' is computed.*do not trust it"),
    (no_version, "Admin.version is ''"),
    (odd_version, "Admin.version is '; DROP'; expected one such as '0.21.1'"),
    (old_version, "database of RTAB-Map 0.11.8; expected 0.13 or later.*rtabmap-reprocess"),
    (cut_off, "SQLite cannot read it: database disk image is malformed"),
    (overwritten, "SQLite cannot read it: database disk image is malformed"),
    (half_written, "hostile.db-journal lies beside it: something still writes"),
    (_node(pose="0 0 0"), "node 1: pose: holds str '0 0 0', expected binary data"),
    (_node(pose=b"abc"), "node 1: pose: 3 bytes, expected 48"),
    (_node(pose=IDENTITY * np.nan), "node 1: pose: the pose holds nan"),
    (_node(pose=IDENTITY * 5), "node 1: pose: R R.T is off the identity by 24"),
    (_node(stamp="noon"), "node 1: stamp 'noon'; expected seconds"),
    (_node(stamp=1.7e18), "node 1: stamp '1.7e.18'; expected seconds"),
    (_node(map_id="x"), "node 1: map_id 'x'"),
    (_node(gps=bytes(40)), "node 1: gps: 40 bytes, expected 48"),
    (_node(gps=np.full(6, 500.0).tobytes()), "node 1: gps: .*expected stamp, longitude, latitude in degrees"),
    (_optimised(IDS, None), "Admin.opt_poses is missing"),
    (_optimised("1", POSES), "Admin.opt_ids: holds str '1'"),
    (_optimised(IDS, POSES[:-1]), "Admin.opt_poses: announces .* and holds 48"),
    (_optimised(compressed(np.array([[1, 2]], "<i4")), POSES), "12 numbers of float32 for 2 ids"),
    (_optimised(compressed(np.array([[1, 1]], "<i4")), compressed(np.tile(IDENTITY, (2, 1)).astype("<f4"))), "twice"),
    (_optimised(IDS, compressed(np.full((1, 12), np.inf, "<f4"))), "Admin.opt_poses: node 1: the pose holds inf"),
    (_link("a", 2, 0), "link a -> 2 of type 0; expected whole numbers"),
    (_link(1, 2, 0, b"short"), "link 1 -> 2: transform: 5 bytes, expected 48"),
    (_link(1, 2, 0, np.full((3, 4), np.inf)), "link 1 -> 2: the pose holds"),
    (_link(1, 2, 0, IDENTITY, "text"), "link 1 -> 2: information_matrix: holds str"),
    (_link(1, 2, 0, IDENTITY, np.eye(3)), "link 1 -> 2: information_matrix: 72 bytes, expected 288"),
]


@pytest.mark.parametrize(("make", "message"), HOSTILE)
def test_hostile_files_are_refused_in_one_message(tmp_path: Path, make: Callable[[Path], None], message: str) -> None:
    path = tmp_path / "hostile.db"
    make(path)
    with pytest.raises(JaxgeoError, match=message) as caught, open_rtabmap(path):
        pass
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, (InputError, GraphError))


def test_huge_values_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "LARGEST_VALUE_BYTES", 1 << 20)
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1)
        small.run("UPDATE Node SET pose = zeroblob(2000000)")
    with pytest.raises(InputError, match="SQLite cannot read it: string or blob too big"), open_rtabmap(small.path):
        pass


def test_one_stamp_for_two_nodes(tmp_path: Path) -> None:
    with SmallDatabase(tmp_path / "a.db") as small:
        small.node(1, stamp=5.0)
        small.node(2, stamp=5.0)
    with open_rtabmap(tmp_path / "a.db") as database, pytest.raises(TrajectoryError, match="nodes 1 and 2 have the st"):
        database.odometry()


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"), open_rtabmap(tmp_path / "gone.db"):
        pass
    os.mkfifo(tmp_path / "pipe.db")
    with pytest.raises(InputError, match="is a device or a pipe"), open_rtabmap(tmp_path / "pipe.db"):
        pass


def test_reading_leaves_no_trace(tmp_path: Path) -> None:
    """Odd characters in the name, write-ahead logging, a read-only folder: nothing is made beside the file."""
    path = tmp_path / "a #1 100% ?mode=rwc.db"
    with SmallDatabase(path) as small:
        small.node(1)
        small.node(2)
    _script(path, "PRAGMA journal_mode = WAL")
    assert path.read_bytes()[18] == 2  # write-ahead logging: whoever opens it to write makes two files beside it
    before = path.read_bytes(), path.stat().st_mtime_ns
    with open_rtabmap(path) as database:
        assert len(database.nodes) == 2
        assert [file.name for file in tmp_path.iterdir()] == [path.name]
        with pytest.raises(sqlite3.DatabaseError):
            database._connection.execute("DELETE FROM Node")
        with pytest.raises(sqlite3.DatabaseError):
            database._connection.execute("ATTACH ? AS other", (str(tmp_path / "other.db"),))
        with pytest.raises(sqlite3.DatabaseError):
            database._connection.execute("PRAGMA query_only = OFF")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before


def test_images_wait_until_they_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with SmallDatabase(tmp_path / "a.db") as small:
        for node in range(1, 5):
            small.node(node)
            small.data(node, image=encoded(picture(node)), depth=encoded(np.ones((6, 8), np.uint16)))
    decoded = []
    kept = database_module.colour_of
    monkeypatch.setattr(database_module, "colour_of", lambda *a: decoded.append(a[0].index) or kept(*a))
    with open_rtabmap(tmp_path / "a.db") as database:
        frames = database.frames()
        next(frames)
        assert decoded == [0]
        next(frames)
        assert decoded == [0, 1]


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
