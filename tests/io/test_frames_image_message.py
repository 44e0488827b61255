"""ROS image messages to BGR: encodings, Bayer patterns, padded rows, byte order, compressed formats."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from bags import KINDS, PackedImage, RawImage, write_bag

from jaxgeo.errors import DetectError
from jaxgeo.io.frames import open_frames
from jaxgeo.io.frames.frame import UnreadableImageError
from jaxgeo.io.frames.image_message import ENCODINGS, image_of_compressed_message, image_of_message

BGR = np.random.default_rng(3).integers(0, 256, (6, 8, 3), dtype=np.uint8)
GREY = BGR[..., 0]
ALPHA = np.full((6, 8, 1), 9, np.uint8)
COLOUR = (200, 110, 30)  # blue, green, red


def message(pixels: np.ndarray, encoding: str, **other) -> SimpleNamespace:
    """As rosbags gives it: the data are a read-only array of bytes."""
    data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
    height, width = pixels.shape[:2]
    fields = {"height": height, "width": width, "step": len(data) // height, "is_bigendian": 0, "data": data}
    return SimpleNamespace(encoding=encoding, **(fields | other))


@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("bgr8", BGR, BGR),
        ("8UC3", BGR, BGR),
        ("rgb8", BGR[..., ::-1], BGR),
        ("bgra8", np.concatenate([BGR, ALPHA], axis=2), BGR),
        ("rgba8", np.concatenate([BGR[..., ::-1], ALPHA], axis=2), BGR),
        ("mono8", GREY, GREY[..., None].repeat(3, axis=2)),
        ("8UC1", GREY, GREY[..., None].repeat(3, axis=2)),
        ("mono16", GREY.astype("<u2") * 256 + 17, GREY[..., None].repeat(3, axis=2)),
        ("bgr16", BGR.astype("<u2") * 256 + 255, BGR),
        ("rgb16", BGR[..., ::-1].astype("<u2") * 256 + 128, BGR),
    ],
)
def test_encodings(encoding, pixels, expected):
    image = image_of_message(message(pixels, encoding), "bag:0")
    np.testing.assert_array_equal(image, expected)
    assert image.dtype == np.uint8
    assert image.flags.writeable
    assert image.flags.c_contiguous


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_colours(pattern, bits):
    """A picture of one colour, seen through each pattern: its first four letters are the top left 2 × 2 pixels."""
    mosaic = np.empty((10, 12), np.uint8)
    for at, letter in enumerate(pattern):
        mosaic[at // 2 :: 2, at % 2 :: 2] = COLOUR["bgr".index(letter)]
    pixels = mosaic if bits == 8 else mosaic.astype("<u2") * 256 + 99
    image = image_of_message(message(pixels, f"bayer_{pattern}{bits}"), "bag:0")
    np.testing.assert_array_equal(image, np.broadcast_to(np.array(COLOUR, np.uint8), (10, 12, 3)))


@pytest.mark.parametrize(
    ("encoding", "order"), [("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv"), ("yuyv", "yuyv")]
)
def test_yuv_colours(encoding, order):
    """Of one colour: Y = 0.257 R + 0.504 G + 0.098 B + 16 and so on, the studio range of BT.601."""
    blue, green, red = COLOUR
    value = {
        "y": 0.257 * red + 0.504 * green + 0.098 * blue + 16,
        "u": -0.148 * red - 0.291 * green + 0.439 * blue + 128,
        "v": 0.439 * red - 0.368 * green - 0.071 * blue + 128,
    }
    pixels = np.tile(np.round([value[letter] for letter in order]).astype(np.uint8), (4, 3)).reshape(4, 6, 2)
    image = image_of_message(message(pixels, encoding), "bag:0")
    assert np.abs(image.astype(int) - COLOUR).max() <= 3


def test_padded_rows():
    padded = np.full((6, 32), 55, np.uint8)
    padded[:, :24] = BGR.reshape(6, 24)
    for data in (padded.ravel(), padded.ravel()[: 5 * 32 + 24]):  # the last row need not be padded
        image = image_of_message(message(BGR, "bgr8", step=32, data=data), "bag:0")
        np.testing.assert_array_equal(image, BGR)


@pytest.mark.parametrize("kind", KINDS)
def test_padded_rows_and_bayer_through_a_bag(tmp_path, kind):
    mosaic = np.tile(np.array([[30, 110], [110, 200]], np.uint8), (5, 6))
    items = [RawImage("/a", 10**18, BGR, step=32), RawImage("/a", 10**18 + 1, mosaic, "bayer_rggb8", step=20)]
    plain, coloured = (frame.image for frame in open_frames(write_bag(tmp_path, kind, items)))
    np.testing.assert_array_equal(plain, BGR)
    np.testing.assert_array_equal(coloured, np.broadcast_to(np.array(COLOUR, np.uint8), (10, 12, 3)))


def test_byte_order():
    """Some drivers set the flag for 8 bits too, where it says nothing."""
    np.testing.assert_array_equal(image_of_message(message(BGR, "bgr8", is_bigendian=1), "bag:0"), BGR)
    with pytest.raises(UnreadableImageError, match=r"bag:0: mono16 in big-endian order, expected little endian"):
        image_of_message(message(GREY.astype(">u2"), "mono16", is_bigendian=1), "bag:0")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"encoding": "16UC1"}, r"encoding '16UC1', expected one of mono8.*depth"),
        ({"step": 23}, r"rows of 23, expected 6 rows of at least 24 bytes \(8 pixels of bgr8\)"),
        ({"data": np.zeros(143, np.uint8)}, "143 bytes in rows of 24"),
        ({"height": 0}, "expected 0 rows"),
        ({"encoding": "yuyv", "width": 7}, "7×6 pixels cannot be of encoding yuyv"),
    ],
)
def test_messages_that_are_refused(changed, expected):
    broken = message(BGR, "bgr8")
    vars(broken).update(changed)
    with pytest.raises(UnreadableImageError, match=f"bag:0: .*{expected}"):
        image_of_message(broken, "bag:0")


def packed(image: np.ndarray, suffix: str, form: str) -> SimpleNamespace:
    return SimpleNamespace(format=form, data=cv2.imencode(suffix, image)[1].ravel())


@pytest.mark.parametrize(
    "form", ["png", "bgr8; png compressed bgr8", "rgb8; png compressed bgr8", "bgr8; png compressed "]
)
def test_compressed_formats(form):
    np.testing.assert_array_equal(image_of_compressed_message(packed(BGR, ".png", form), "bag:0"), BGR)


def test_compressed_images_whose_channels_are_exchanged():
    """`compressed rgb8`: the encoder took the camera's RGB for BGR."""
    exchanged = packed(BGR[..., ::-1], ".png", "rgb8; png compressed rgb8")
    np.testing.assert_array_equal(image_of_compressed_message(exchanged, "bag:0"), BGR)


@pytest.mark.parametrize("kind", KINDS)
def test_jpeg_through_a_bag(tmp_path, kind):
    data = cv2.imencode(".jpg", BGR)[1].tobytes()
    items = [PackedImage("/a", 10**18, data, "rgb8; jpeg compressed bgr8"), PackedImage("/a", 10**18 + 1, data[:200])]
    source = open_frames(write_bag(tmp_path, kind, items))
    frames = source.frames()
    np.testing.assert_array_equal(next(frames).image, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    with pytest.raises(DetectError, match=r":1 \(/a\) \(format 'jpeg'\): 200 bytes, beginning with ff d8 ff"):
        next(frames)


@pytest.mark.parametrize("form", ["16UC1; compressedDepth png", "bayer_rggb8; png compressed bayer_rggb8"])
def test_compressed_formats_that_are_refused(form):
    with pytest.raises(UnreadableImageError, match="expected JPEG or PNG in colours or grey"):
        image_of_compressed_message(packed(BGR, ".png", form), "bag:0")


def test_every_encoding_is_tested():
    tested = {mark for test in (test_encodings, test_bayer_colours, test_yuv_colours) for mark in _encodings(test)}
    assert tested == set(ENCODINGS)


def _encodings(test) -> set[str]:
    marks = {mark.args[0]: mark.args[1] for mark in test.pytestmark}
    if "pattern" in marks:
        return {f"bayer_{pattern}{bits}" for pattern in marks["pattern"] for bits in marks["bits"]}
    (values,) = marks.values()
    return {value[0] for value in values}
