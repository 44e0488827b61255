"""Frames, scans and cameras of a database: one by one, in order of time; bad ones refused or left out."""

from pathlib import Path

import numpy as np
import pytest
from rtabmap_database import (
    SmallDatabase,
    camera_blob,
    compressed,
    encoded,
    projection,
    rvl,
    scan_info_blob,
    stereo_blob,
)

from jaxgeo.errors import InputError, ScanError
from jaxgeo.io.rtabmap import database as database_module
from jaxgeo.io.rtabmap.database import open_rtabmap


def picture(value: int, width: int = 8) -> np.ndarray:
    return np.full((6, width, 3), [value, 10, 200], np.uint8)


def test_frames_and_scans_come_one_by_one_in_order_of_time(tmp_path: Path) -> None:
    depth = np.arange(48, dtype=np.uint16).reshape(6, 8) * 100
    rows = np.array([[1, 2, 3, 50, 0.01], [4, 5, 6, 60, -0.02]], "<f4")
    with SmallDatabase(tmp_path / "a.db") as small:
        for node, stamp in ((1, 20.0), (2, 10.0), (3, 30.0), (4, 40.0)):
            small.node(node, stamp=stamp)
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
    "cut off": ({"image": encoded(picture(1))[:50]}, "node 1: image: 50 bytes.*the last part claims 32 more"),
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
