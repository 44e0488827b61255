"""Every binary value: what is written from the description reads back; what is damaged is refused in one message."""

import contextlib
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from rtabmap_database import (
    OPTICAL,
    camera_blob,
    compressed,
    encoded,
    projection,
    rvl,
    scan_info_blob,
    stereo_blob,
)

from jaxgeo.errors import InputError, ScanError
from jaxgeo.io.rtabmap.blobs import LARGEST_ARRAY_BYTES, blob, compressed_array, pose_blob
from jaxgeo.io.rtabmap.calibration_blob import StoredCamera, camera_of, stored_cameras
from jaxgeo.io.rtabmap.image_blob import colour_image, depth_image_m, depth_mm, image_size
from jaxgeo.io.rtabmap.rvl import decode_rvl
from jaxgeo.io.rtabmap.scan_blob import scan_info, scan_points

NEW, OLD = (0, 21, 1), (0, 17, 6)


@given(
    hnp.arrays(np.dtype("<f4"), st.tuples(st.integers(1, 4), st.integers(1, 9)), elements=st.floats(-9, 9, width=32))
)
def test_matrices_decompress_to_what_was_compressed(array: np.ndarray) -> None:
    np.testing.assert_array_equal(compressed_array(compressed(array), "x"), array)
    read = compressed_array(compressed(array, array.shape[1]), "x")
    np.testing.assert_array_equal(read.reshape(array.shape), array)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"abc", "3 bytes, too few"),
        (compressed(np.zeros((2, 3), "<f4"))[:-1], "announces .* bytes and holds 24"),
        (b"garbage" + struct.pack("<3i", 2, 3, 5), "is no zlib stream"),
        (zlib.compress(bytes(24))[:-6] + struct.pack("<3i", 2, 3, 5), "announces 24 bytes and holds 24|holds"),
        (zlib.compress(bytes(20)) + struct.pack("<3i", 2, 3, 5), "announces 24 bytes and holds 20"),
        (zlib.compress(bytes(10**7)) + struct.pack("<3i", 2, 3, 5), "announces 24 bytes and holds more"),
        (zlib.compress(bytes(24)) + struct.pack("<3i", -2, 3, 5), "announces a matrix of -2 x 3"),
        (zlib.compress(bytes(24)) + struct.pack("<3i", 2, 3, 7), "OpenCV type 7, which there is not"),
        (zlib.compress(bytes(24)) + struct.pack("<3i", 60000, 60000, 5), rf"expected at most {LARGEST_ARRAY_BYTES}"),
    ],
)
def test_matrices_refused(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=f"^db: node 3: scan: .*{message}"):
        compressed_array(data, "db: node 3: scan")


def test_no_more_is_unpacked_than_was_announced() -> None:
    bomb = zlib.compress(bytes(10**7)) + struct.pack("<3i", 2, 3, 5)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="holds more"):
            compressed_array(bomb, "x")
        assert tracemalloc.get_traced_memory()[1] < 10**5
    finally:
        tracemalloc.stop()


def test_plain_values() -> None:
    assert pose_blob(None, "x") is None
    assert pose_blob(bytes(48), "x") is None  # RTAB-Map's null pose
    np.testing.assert_array_equal(pose_blob(OPTICAL.astype("<f4").tobytes(), "x"), OPTICAL.astype("<f4"))
    with pytest.raises(InputError, match=r"x: 44 bytes, expected 48 \(12 numbers\)"):
        pose_blob(bytes(44), "x")
    with pytest.raises(InputError, match=r"x: holds str 'text', expected binary data"):
        blob("text", "x")


depths = hnp.arrays(
    np.uint16,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=12),
    elements=st.one_of(st.just(0), st.integers(1, 40), st.integers(0, 65535)),
)


@given(depths)
def test_rvl_decodes_to_what_was_encoded(depth: np.ndarray) -> None:
    data = rvl(depth)
    np.testing.assert_array_equal(decode_rvl(data[16:], depth.size).reshape(depth.shape), depth)
    expected = np.where(depth == 65535, 0, depth) * np.float32(0.001)
    np.testing.assert_array_equal(depth_image_m(data, "x"), expected)


def test_rvl_of_a_known_stream() -> None:
    """Two zeros, then 5 and 3: counts 2 and 2, differences +5 -> 10 (nibbles 2|8, 1) and -2 -> 3."""
    assert decode_rvl(struct.pack("<I", 0x22A13000), 4).tolist() == [0, 0, 5, 3]


@given(st.binary(max_size=64), st.integers(1, 200))
def test_rvl_of_anything_ends(data: bytes, n_pixels: int) -> None:
    with contextlib.suppress(ValueError):
        assert len(decode_rvl(data, n_pixels)) == n_pixels


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_sizes_are_read_without_decoding(suffix: str) -> None:
    data = encoded(np.zeros((7, 13, 3), np.uint8), suffix)
    assert image_size(data, "x") == (13, 7)
    assert image_size(rvl(np.zeros((7, 13), np.uint16)), "x") == (13, 7)


def huge_png() -> bytes:
    """A kilobyte that announces a gigapixel."""
    data = encoded(np.zeros((4, 4), np.uint8))
    return data[:16] + struct.pack(">II", 40000, 40000) + data[24:]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (huge_png(), "announces 40000 x 40000 pixels; expected 1 to 100000000"),
        (b"DEPTHRVL" + struct.pack("<II", 2**31, 2**31), "pixels; expected 1 to"),
        (b"DEPTHRVL" + struct.pack("<II", 4, 4), "colour image coded as RVL"),
        (b"BM1234567890", "beginning with 42 4d 31.*expected a JPEG, PNG or RVL"),
        (encoded(np.zeros((4, 4), np.uint8))[:20], "the png image of 20 bytes ends within its head"),
        (encoded(np.zeros((4, 4), np.uint8), ".jpg")[:30], "the jpg image of 30 bytes ends within its head"),
        (encoded(np.zeros((4, 4), np.uint8))[:40], "no image that OpenCV can decode"),
    ],
)
def test_images_refused(data: bytes, message: str) -> None:
    with pytest.raises(ScanError, match=message):
        colour_image(data, "x")


def test_kinds_of_depth() -> None:
    depth = np.array([[0, 1000, 65535], [1500, 1, 65534]], np.uint16)
    read = depth_image_m(encoded(depth), "x")
    assert read is not None
    np.testing.assert_allclose(read, [[0, 1, 0], [1.5, 0.001, 65.534]], rtol=1e-6)
    metres = np.array([[0.25, np.nan, 80.0], [-1.0, np.inf, 3.0]], "<f4")
    read = depth_image_m(encoded(metres.view(np.uint8).reshape(2, 3, 4)), "x")
    assert read is not None
    np.testing.assert_array_equal(read, [[0.25, 0, 80], [0, 0, 3]])
    stored, n_far = depth_mm(read)
    assert stored.tolist() == [[250, 0, 0], [0, 0, 3000]]
    assert n_far == 1
    right = np.zeros((4, 4), np.uint8)
    assert depth_image_m(encoded(right), "x") is None
    assert depth_image_m(encoded(right, ".jpg"), "x") is None
    with pytest.raises(ScanError, match="the RVL depth is damaged: the stream ends after 0 of 4"):
        depth_image_m(b"DEPTHRVL" + struct.pack("<II", 2, 2), "x")
    with pytest.raises(ScanError, match="depth of uint16"):
        depth_image_m(encoded(np.zeros((4, 4, 3), np.uint16)), "x")


def test_a_camera_with_projection_is_rectified() -> None:
    data = camera_blob(D=[0.1, 0.2, 0.3, 0.4, 0.5], P=projection(20.0))
    (stored,) = stored_cameras(data, NEW, "x")
    camera = camera_of(stored, True, "x")
    assert camera.intrinsics_px.tolist() == [20, 20, 4.5, 3.5]
    assert (camera.distortion_model, camera.distortion.tolist()) == ("none", [])
    assert camera.resolution_px == (8, 6)
    np.testing.assert_allclose(camera.t_body_cam_m, [0.1, 0.2, 0.3], atol=1e-7)
    quat = camera.quat_body_cam_wxyz * np.sign(camera.quat_body_cam_wxyz[0])
    np.testing.assert_allclose(quat, [0.5, -0.5, 0.5, -0.5], atol=1e-7)
    raw = camera_of(stored, False, "x")
    assert raw.intrinsics_px.tolist() == [10, 11, 4, 3]
    assert (raw.distortion_model, raw.distortion.tolist()) == ("radtan", [0.1, 0.2, 0.3, 0.4, 0.5])


@pytest.mark.parametrize(
    ("D", "model", "distortion"),
    [
        ([], "none", []),
        ([0, 0, 0, 0], "none", []),
        ([1, 2, 3, 4], "radtan", [1, 2, 3, 4]),
        ([1, 2, 0, 0, 3, 4], "equidistant", [1, 2, 3, 4]),
        ([1, 2, 3, 4, 5, 0, 0, 0], "radtan", [1, 2, 3, 4, 5]),
    ],
)
def test_distortions(D: list[float], model: str, distortion: list[float]) -> None:
    (stored,) = stored_cameras(camera_blob(D=D), NEW, "x")
    camera = camera_of(stored, True, "x")
    assert (camera.distortion_model, camera.distortion.tolist()) == (model, distortion)


def test_the_rational_model_is_refused() -> None:
    (stored,) = stored_cameras(camera_blob(D=[1, 2, 3, 4, 5, 6, 7, 8]), NEW, "x")
    with pytest.raises(ScanError, match=r"8 distortion coefficients .* the rational model"):
        camera_of(stored, True, "x")


def centre(camera: StoredCamera) -> np.ndarray:
    return camera.T_body_cam[:, 3]


def test_several_cameras_and_stereo() -> None:
    two = stored_cameras(camera_blob(fx=10) + camera_blob(fx=30, P=projection(30)), NEW, "x")
    assert [camera.K[0, 0] for camera in two] == [10, 30]
    assert [camera.right for camera in two] == [False, False]
    pair = stereo_blob(camera_blob(P=projection(20)), camera_blob(P=projection(20, 0.25)))
    left, right = stored_cameras(pair, NEW, "x")
    assert (left.right, right.right) == (False, True)
    # x right in the camera is -y of the body
    np.testing.assert_allclose(centre(right) - centre(left), [0, -0.25, 0], atol=1e-7)
    # The same from x_right = R x_left + T
    raw = stereo_blob(camera_blob(), camera_blob(), np.eye(3), np.array([-0.25, 0, 0]))
    np.testing.assert_allclose(centre(stored_cameras(raw, NEW, "x")[1]), centre(right), atol=1e-7)
    with pytest.raises(ScanError, match="its baseline is not known"):
        stored_cameras(stereo_blob(camera_blob(), camera_blob()), NEW, "x")


def test_cameras_before_0_18() -> None:
    row = np.concatenate([[10, 11, 4, 3, 8, 6], OPTICAL.ravel()]).astype("<f4")
    first, second = stored_cameras(row.tobytes() * 2, OLD, "x")
    assert first.K.tolist() == second.K.tolist() == [[10, 0, 4], [0, 11, 3], [0, 0, 1]]
    assert first.size == (8, 6)
    stereo = np.concatenate([[10, 11, 4, 3, 0.5, 8, 6], OPTICAL.ravel()]).astype("<f4")
    left, right = stored_cameras(stereo.tobytes(), OLD, "x")
    np.testing.assert_allclose(centre(right) - centre(left), [0, -0.5, 0], atol=1e-7)
    with pytest.raises(ScanError, match="70 bytes, expected 72 for each camera"):
        stored_cameras(bytes(70), OLD, "x")


def replaced(data: bytes, at: int, value: int) -> bytes:
    return data[: 4 * at] + struct.pack("<i", value) + data[4 * at + 4 :]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (camera_blob()[:30], "ends within the head of a camera, at byte 30"),
        (camera_blob()[:42], "ends within the head of a camera, at byte 42"),
        (camera_blob()[:-8], "ends within a camera"),
        (replaced(camera_blob(), 3, 7), "a camera of type 7"),
        (replaced(camera_blob(), 6, 10), "10 numbers of K; expected 9"),
        (replaced(camera_blob(), 7, 2**30), "1073741824 numbers of D"),
        (replaced(camera_blob(), 4, -8), "an image size of -8 x 6"),
        (camera_blob(fx=-5), "focal lengths -5, -4 in K"),
        (camera_blob(fx=np.nan), "holds numbers that are not finite"),
        (camera_blob(local=np.zeros((3, 4))), "no local transform"),
        (camera_blob(local=2 * OPTICAL), "camera 0: local transform: R R.T is off the identity"),
        (stereo_blob(camera_blob(P=projection(2)), camera_blob(P=projection(2)))[:-8], "ends within a camera"),
        (stereo_blob(b"", b"") + 2 * camera_blob(), r"announces 0 \+ 0 bytes"),
        (replaced(stereo_blob(camera_blob(), camera_blob()), 4, 5), "5 numbers of the stereo R"),
    ],
)
def test_calibrations_refused(data: bytes, message: str) -> None:
    with pytest.raises(ScanError, match=f"^db: node 3: calibration: .*{message}"):
        stored_cameras(data, NEW, "db: node 3: calibration")


LOCAL = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]])
CHANNELS = {1: 2, 2: 3, 3: 5, 4: 6, 5: 3, 6: 4, 7: 4, 8: 6, 9: 7, 10: 7, 11: 5}


@pytest.mark.parametrize(("format", "channels"), CHANNELS.items())
def test_scans_of_every_format(format: int, channels: int) -> None:
    rows = (np.arange(3 * channels, dtype="<f4").reshape(3, channels) + 1) / 8
    info = scan_info(scan_info_blob(format, LOCAL), NEW, "x")
    read = scan_points(compressed(rows, channels), info, "x")
    xyz = np.column_stack([rows[:, :2], np.zeros(3) if format < 5 else rows[:, 2]])
    np.testing.assert_array_equal(read.points_m, np.column_stack([1 - xyz[:, 1], 2 + xyz[:, 0], 3 + xyz[:, 2]]))
    at = {2: 2, 4: 2, 6: 3, 9: 3, 11: 3}.get(format)
    assert (read.intensity is None) == (at is None)
    if at is not None:
        np.testing.assert_array_equal(read.intensity, rows[:, at])
    assert (read.time_s is None) == (format != 11)
    if format == 11:
        np.testing.assert_array_equal(read.time_s, rows[:, 4])


def test_returns_of_nothing_are_dropped_and_counted() -> None:
    rows = np.array([[1, 2, 3, 9], [0, 0, 0, 9], [np.nan, 0, 0, 9], [4, 5, 6, 8]], "<f4")
    read = scan_points(compressed(rows, 4), scan_info(scan_info_blob(6), NEW, "x"), "x")
    assert read.points_m.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert read.intensity is not None
    assert read.intensity.tolist() == [9, 8]
    assert read.n_empty == 2


def test_scans_of_old_databases() -> None:
    rows = np.ones((2, 4), "<f4")
    without = np.concatenate([[100, 30], LOCAL.ravel()]).astype("<f4").tobytes()
    with_format = np.concatenate([[100, 30, 6], LOCAL.ravel()]).astype("<f4").tobytes()
    assert scan_points(compressed(rows, 4), scan_info(without, OLD, "x"), "x").intensity is None  # XYZRGB
    read = scan_points(compressed(rows, 4), scan_info(with_format, OLD, "x"), "x")
    assert read.intensity is not None
    assert read.points_m.tolist() == [[0, 3, 4], [0, 3, 4]]


@pytest.mark.parametrize(
    ("info", "rows", "message"),
    [
        (None, np.ones((2, 4)), "no scan_info"),
        (scan_info_blob(12), np.ones((2, 4)), "scan format 12 is not known; expected one of 1 XY"),
        (scan_info_blob(6)[:-4], np.ones((2, 4)), "72 bytes, expected 76"),
        (scan_info_blob(6, 3 * LOCAL), np.ones((2, 4)), "local transform: R R.T is off"),
        (scan_info_blob(5), np.ones((2, 4)), "4 channels of float32; the format XYZ has 3"),
        (scan_info_blob(11), np.full((2, 5), 1.7e9), "point times up to 1.7e.09 s"),
    ],
)
def test_scans_refused(info: bytes | None, rows: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        scan_points(compressed(rows.astype("<f4"), rows.shape[1]), scan_info(info, NEW, "x"), "x")
