"""Readers of ROS bags and of RTAB-Map's databases, with small valid files made by the tests' own writers."""

import functools
import struct
import sys
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz import checks
from benchmarks.fuzz.binary_targets import encoded
from benchmarks.fuzz.target import Target
from jaxgeo.io.frames.bag import BagFrames
from jaxgeo.io.rgbd.bag import BagRgbd
from jaxgeo.io.rtabmap.blobs import compressed_array, pose_blob
from jaxgeo.io.rtabmap.calibration_blob import rig_of, stored_cameras
from jaxgeo.io.rtabmap.database import open_rtabmap
from jaxgeo.io.rtabmap.image_blob import colour_image, depth_image_m
from jaxgeo.io.rtabmap.scan_blob import scan_info, scan_points
from jaxgeo.io.scans.bag import BagScans

# Writers of small bags and databases: the tests', so that there is one of each.
_TESTS = Path(__file__).resolve().parents[2] / "tests"
sys.path += [str(folder) for folder in (_TESTS, _TESTS / "io") if str(folder) not in sys.path]

_VERSION = (0, 21, 1)
_DEPTH = np.arange(48, dtype=np.uint16).reshape(6, 8)


def _image_bag(kind: str, compressed: bool = False) -> bytes:
    from bags import PackedImage, RawImage, write_bag

    picture = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    raw = [RawImage("/camera", 10**9 * i, picture + i) for i in (1, 2)]
    packed = [PackedImage("/camera", 10**9 * i, encoded(".jpg")) for i in (1, 2)]
    with tempfile.TemporaryDirectory() as folder:
        return _single_file(write_bag(Path(folder), kind, [*(packed if compressed else raw)]))


def _cloud_bag(kind: str) -> bytes:
    from cloud_bags import Cloud, write_cloud_bag

    points = np.zeros(5, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4")])
    points["x"], points["t"] = np.arange(1, 6), np.arange(5) * 20_000_000
    with tempfile.TemporaryDirectory() as folder:
        path = write_cloud_bag(Path(folder), kind, [Cloud("/points", 10**9 * i, points) for i in (1, 2)])
        return _single_file(path)


def _rgbd_bag() -> bytes:
    from bags import RawImage, write_bag

    picture = np.zeros((6, 8, 3), np.uint8)
    items = [RawImage("/color/image_raw", 10**9, picture), RawImage("/depth/image_raw", 10**9, _DEPTH, "16UC1")]
    with tempfile.TemporaryDirectory() as folder:
        return _single_file(write_bag(Path(folder), "ros1", [*items]))


def _single_file(path: Path) -> bytes:
    """The bag's data; of a folder, those of the one file beside metadata.yaml."""
    file = path if path.is_file() else next(p for p in sorted(path.iterdir()) if p.suffix in (".mcap", ".db3"))
    return file.read_bytes()


@functools.cache
def _bag_folder() -> tuple[tempfile.TemporaryDirectory, Path]:
    from bags import RawImage, write_bag

    folder = tempfile.TemporaryDirectory()
    picture = np.zeros((4, 6, 3), np.uint8)
    return folder, write_bag(Path(folder.name), "mcap", [RawImage("/camera", 10**9, picture)])


def _metadata() -> bytes:
    return (_bag_folder()[1] / "metadata.yaml").read_bytes()


def _of_metadata(path: Path) -> Any:
    """The images of a sound bag beside damaged metadata."""
    bag = _bag_folder()[1]
    sound = _metadata()
    try:
        (bag / "metadata.yaml").write_bytes(path.read_bytes())
        return list(BagFrames(bag))
    finally:
        (bag / "metadata.yaml").write_bytes(sound)


def _check_images(value: list[Any]) -> None:
    for frame in value:
        assert np.isfinite(frame.stamp_s)
        checks.bgr(frame.image)


def _database() -> bytes:
    from rtabmap_database import SmallDatabase, camera_blob, compressed, scan_info_blob
    from rtabmap_database import encoded as packed_image

    identity = np.eye(4)[:3]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "small.db"
        with SmallDatabase(path) as database:
            for node in (1, 2, 3):
                pose = identity.copy()
                pose[0, 3] = node
                database.node(node, pose, ground_truth_pose=pose)
                database.data(
                    node,
                    image=packed_image(np.full((6, 8, 3), 40 * node, np.uint8)),
                    depth=packed_image(_DEPTH),
                    calibration=camera_blob(),
                    scan=compressed(np.arange(12, dtype="<f4").reshape(4, 3) + 1.0, channels=3),
                    scan_info=scan_info_blob(5),
                )
                if node > 1:
                    database.link(node - 1, node, 0, identity)
            database.optimised([1, 2, 3], np.tile(identity, (3, 1, 1)))
        return path.read_bytes()


def _all_of_database(path: Path) -> Any:
    with open_rtabmap(path) as database:
        trajectories = [*database.odometry().values(), database.optimised(), database.truth()]
        rig = database.rig()
        return trajectories, database.graph(), rig, list(database.frames()), list(database.scans())


def _check_database(value: Any) -> None:
    trajectories, _, rig, frames, scans = value
    for trajectory in trajectories:
        if trajectory is not None:
            checks.trajectory(trajectory)
    if rig is not None:
        checks.rig(rig)
    checks.rgbd_frames(frames)
    checks.scans(scans)


def _calibrations() -> tuple[bytes, ...]:
    from rtabmap_database import camera_blob, projection, stereo_blob

    one, fisheye = camera_blob(D=(0.1, 0.2, 0, 0, 0)), camera_blob(D=(0.1, 0.2, 0, 0, 0.01, 0.02))
    pair = stereo_blob(camera_blob(P=projection(10.0)), camera_blob(P=projection(10.0, 0.1)))
    return one, fisheye, one + one, pair, stereo_blob(one, one, np.eye(3), np.array([-0.1, 0, 0]))


def _rig(path: Path, version: tuple[int, ...]) -> Any:
    return rig_of(stored_cameras(path.read_bytes(), version, str(path)), False, str(path))


def _check_rig(value: Any) -> None:
    if value is not None:
        checks.rig(value)


def _scan_value() -> bytes:
    """What `_points` packs: the matrix, then rows, columns and type."""
    return np.linspace(0.1, 2.0, 20, dtype="<f4").tobytes() + struct.pack("<3i", 1, 4, 5 + (4 << 3))


def _points(path: Path, format: int) -> Any:
    from rtabmap_database import scan_info_blob

    data, place = path.read_bytes(), str(path)
    info = scan_info(scan_info_blob(format), _VERSION, place)
    return scan_points(zlib.compress(data[:-12]) + data[-12:], info, place)


def _check_points(value: Any) -> None:
    n = len(value.points_m)
    assert value.points_m.shape == (n, 3)
    assert np.isfinite(value.points_m).all()
    assert value.time_s is None or (value.time_s.shape == (n,) and np.isfinite(value.time_s).all())


def _compressed() -> tuple[bytes, ...]:
    from rtabmap_database import compressed

    return compressed(np.arange(12, dtype="<f4").reshape(3, 4)), compressed(np.arange(12, dtype="u1").reshape(4, 3), 3)


def _depth_images() -> tuple[bytes, ...]:
    from rtabmap_database import rvl

    return encoded(".png", _DEPTH), rvl(_DEPTH), encoded(".png", np.zeros((6, 8, 4), np.uint8)), encoded(".jpg")


def _info(path: Path) -> Any:
    data, place = path.read_bytes(), str(path)
    return scan_info(data, _VERSION if len(data) == 76 else (0, 17), place)


def _infos() -> tuple[bytes, ...]:
    from rtabmap_database import scan_info_blob

    local = np.eye(4, dtype="<f4")[:3].tobytes()
    return scan_info_blob(5), struct.pack("<3f", 1000, 30, 5) + local, struct.pack("<2f", 1000, 30) + local


def _of_bytes(read: Callable[[bytes, str], Any]) -> Callable[[Path], Any]:
    return lambda path: read(path.read_bytes(), str(path))


def _bag(
    name: str, suffix: str, read: Callable[[Path], Any], check: Callable[[Any], None], *examples: Callable[[], bytes],
    covers: str,
) -> Target:  # fmt: skip
    return Target(name, suffix, "binary", read, check, lambda: tuple(make() for make in examples),
                  (covers, "jaxgeo.io.bag_reader.BagReader"))  # fmt: skip


_FRAMES, _CLOUDS = "jaxgeo.io.frames.bag.BagFrames", "jaxgeo.io.scans.bag.BagScans"
_RTABMAP = "jaxgeo.io.rtabmap"


def _value(
    name: str,
    read: Callable[[Path], Any],
    check: Callable[[Any], None],
    examples: Callable[[], tuple[bytes, ...]],
    *covers: str,
) -> Target:
    return Target(name, ".blob", "binary", read, check, examples, tuple(f"{_RTABMAP}.{each}" for each in covers))


RECORDING_TARGETS = (
    _bag(
        *("bag-ros1-images", ".bag", lambda path: list(BagFrames(path)), _check_images),
        *(lambda: _image_bag("ros1"), lambda: _image_bag("ros1", compressed=True)),
        covers=_FRAMES,
    ),
    _bag(
        *("bag-mcap-images", ".mcap", lambda path: list(BagFrames(path)), _check_images, lambda: _image_bag("mcap")),
        covers=_FRAMES,
    ),
    _bag(
        *("bag-sqlite-images", ".db3", lambda path: list(BagFrames(path)), _check_images),
        lambda: _image_bag("sqlite3"),
        covers=_FRAMES,
    ),
    _bag(
        *("bag-ros1-clouds", ".bag", lambda path: list(BagScans(path)), checks.scans, lambda: _cloud_bag("ros1")),
        covers=_CLOUDS,
    ),
    _bag(
        *("bag-mcap-clouds", ".mcap", lambda path: list(BagScans(path)), checks.scans, lambda: _cloud_bag("mcap")),
        covers=_CLOUDS,
    ),
    _bag(
        *("bag-ros1-rgbd", ".bag", lambda path: list(BagRgbd(path)), checks.rgbd_frames, _rgbd_bag),
        covers="jaxgeo.io.rgbd.bag.BagRgbd",
    ),
    Target(
        *("bag-metadata", ".yaml", "text", _of_metadata, _check_images, lambda: (_metadata(),)),
        covers=(_FRAMES,),
        places=False,
    ),
    Target(
        *("rtabmap", ".db", "binary", _all_of_database, _check_database, lambda: (_database(),)),
        covers=(f"{_RTABMAP}.database.open_rtabmap",),
    ),
    _value(
        "rtabmap-camera",
        functools.partial(_rig, version=_VERSION),
        _check_rig,
        _calibrations,
        "calibration_blob.stored_cameras",
        "calibration_blob.rig_of",
    ),
    _value(
        *("rtabmap-old-camera", functools.partial(_rig, version=(0, 17, 0)), _check_rig),
        lambda: (
            np.array([10, 11, 4, 3, 8, 6, *np.eye(4)[:3].ravel()], "<f4").tobytes(),
            np.array([10, 11, 4, 3, 0.1, 8, 6, *np.eye(4)[:3].ravel()], "<f4").tobytes(),
        ),
        "calibration_blob.stored_cameras",
    ),
    *(
        _value(
            f"rtabmap-scan-{format}",
            functools.partial(_points, format=format),
            _check_points,
            lambda: (_scan_value(),),
            "scan_blob.scan_points",
        )
        for format in (0, 11)
    ),
    _value("rtabmap-scan-info", _info, checks.nothing, _infos, "scan_blob.scan_info"),
    _value("rtabmap-matrix", _of_bytes(compressed_array), checks.nothing, _compressed, "blobs.compressed_array"),
    _value(
        "rtabmap-pose",
        _of_bytes(pose_blob),
        checks.nothing,
        lambda: (np.eye(4, dtype="<f4")[:3].tobytes(),),
        "blobs.pose_blob",
    ),
    _value(
        "rtabmap-colour",
        _of_bytes(colour_image),
        checks.bgr,
        lambda: (encoded(".jpg"), encoded(".png")),
        "image_blob.colour_image",
    ),
    _value("rtabmap-depth", _of_bytes(depth_image_m), checks.depth, _depth_images, "image_blob.depth_image_m"),
)
