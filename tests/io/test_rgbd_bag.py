"""RGB-D frames out of bags, written here by rosbags' own writers."""

import struct

import cv2
import numpy as np
import pytest
from bags import KINDS, PackedImage, RawImage, Text, write_bag

from jaxgeo.errors import ScanError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.rgbd import BagRgbd, open_rgbd

T0_NS = 1_403_636_579_763_555_584
COLOUR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"


def picture(i: int) -> np.ndarray:
    return np.random.default_rng(i).integers(0, 256, (6, 8, 3), dtype=np.uint8)


def steps(i: int) -> np.ndarray:
    return np.random.default_rng(i).integers(1, 6000, (6, 8)).astype(np.uint16)


def items(n: int = 4, gap_ns: int = 3_000_000) -> list:
    out = []
    for i in range(n):
        at = T0_NS + i * 33_000_000
        out += [RawImage(COLOUR, at, picture(i)), RawImage(DEPTH, at + gap_ns, steps(i), "16UC1"), Text("/notes", at)]
    return out


def check(source, expected: list[int]) -> None:
    frames = list(source)
    assert [frame.index for frame in frames] == list(range(len(expected)))
    for frame, i in zip(frames, expected, strict=True):
        assert frame.stamp_s == (T0_NS + i * 33_000_000) / 10**9
        np.testing.assert_array_equal(frame.image, picture(i))
        np.testing.assert_array_equal(frame.depth_m, (steps(i) / 1000).astype(np.float32))


@pytest.mark.parametrize("kind", KINDS)
def test_pairs_come_back(tmp_path, kind):
    source = open_rgbd(write_bag(tmp_path, kind, items()))
    assert isinstance(source, BagRgbd)
    assert source.n_frames is None
    check(source, [0, 1, 2, 3])
    assert [frame.index for frame in source.frames(3)] == [3]
    assert not list(source.frames(4))


def test_images_without_a_partner_are_counted(tmp_path):
    recorded = items()
    del recorded[4]  # depth 1
    recorded[6].stamp_ns += 15_000_000  # colour 2: nearer to no other
    source = open_rgbd(write_bag(tmp_path, "mcap", recorded), max_gap_s=0.005)
    with pytest.warns(InputWarning, match=r"2 of 4 colour and 1 of 3 depth images have no partner within 0\.005 s"):
        stamps = [frame.stamp_s for frame in source]
    assert stamps == [T0_NS / 1e9, (T0_NS + 99_000_000) / 10**9]


def test_other_ways_to_send_depth(tmp_path):
    inverse = np.full((6, 8), 3000, np.uint16)
    inverse[0, 0] = 0
    png = cv2.imencode(".png", inverse)[1].tobytes()
    a, b = 5000.0, 500.0
    metres = np.full((6, 8), 1.25, np.float32)
    metres[0, 0] = np.nan
    expected = {
        "float": (RawImage("/d/depth", T0_NS, metres, "32FC1"), 1.25),
        "big": (RawImage("/d/depth", T0_NS, np.full((6, 8), 1250, ">u2"), "16UC1", big_endian=True), 1.25),
        "padded": (RawImage("/d/depth", T0_NS, np.full((6, 8), 1250, np.uint16), "mono16", step=23), 1.25),
        "png": (PackedImage("/d/depth", T0_NS, png, "png"), 3.0),
        "transport": (PackedImage("/d/depth", T0_NS, bytes(12) + png, "16UC1; compressedDepth png"), 3.0),
        "inverse": (
            PackedImage("/d/depth", T0_NS, struct.pack("<iff", 0, a, b) + png, "32FC1; compressedDepth"),
            a / (3000 - b),
        ),
    }
    for name, (depth, value_m) in expected.items():
        (tmp_path / name).mkdir()
        (frame,) = open_rgbd(write_bag(tmp_path / name, "ros1", [RawImage("/rgb", T0_NS, picture(0)), depth]))
        np.testing.assert_allclose(frame.depth_m[1:], value_m, rtol=1e-6, err_msg=name)
        assert frame.depth_m[0, 0] == (0 if name not in ("big", "padded") else np.float32(1.25))


def test_topics_that_do_not_fit(tmp_path):
    path = write_bag(tmp_path, "ros1", [*items(), RawImage("/left/depth", T0_NS, steps(9), "16UC1")])
    for topics, message in (
        (None, rf"1 image topics without and 2 with 'depth'.*`topics` \(color: .*\n  {DEPTH}  sensor_msgs/msg/Image"),
        ({"color": COLOUR}, "topics of color, expected of color and of depth"),
        ({"color": COLOUR, "depth": "/depth"}, "no topic '/depth'"),
        ({"color": "/notes", "depth": DEPTH}, "'/notes' is of type std_msgs"),
    ):
        with pytest.raises(ScanError, match=message):
            open_rgbd(path, topics=topics)
    check(open_rgbd(path, topics={"color": COLOUR, "depth": DEPTH}), [0, 1, 2, 3])
    for topics, message in (
        ({"color": DEPTH, "depth": COLOUR}, r"encoding '16UC1', expected one of mono8"),
        ({"color": COLOUR, "depth": COLOUR}, r"encoding 'bgr8', expected depth: 16UC1, mono16, 32FC1"),
    ):
        with pytest.raises(ScanError, match=message):
            list(open_rgbd(path, topics=topics))


def test_streams_of_different_clocks(tmp_path):
    path = write_bag(tmp_path, "ros1", items(gap_ns=10**9))
    with pytest.raises(ScanError, match=r"none of 4 colour and 4 depth images has a partner.*different clocks"):
        list(open_rgbd(path))


def test_what_comes_before_a_jump_of_the_clock_is_read(tmp_path):
    recorded = items()
    recorded[9].received_ns = recorded[9].stamp_ns
    recorded[9].stamp_ns = T0_NS  # colour 3
    source = open_rgbd(write_bag(tmp_path, "ros1", recorded), on_bad="skip")
    with pytest.warns(InputWarning, match=r":3 .*stamp \S+ s after \S+ s of message 2"):
        check(source, [0, 1, 2])
    assert list(source.bad) == [3]
