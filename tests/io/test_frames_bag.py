"""Images out of ROS 1 bags, ROS 2 bags and MCAP files, written here by rosbags' own writers."""

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from bags import KINDS, PackedImage, RawImage, Text, Unused, write_bag
from data_root import data_root

from jaxgeo.errors import DetectError
from jaxgeo.io.frames import BagFrames, open_frames
from jaxgeo.io.input_warning import InputWarning

T0_NS = 1_403_636_579_763_555_584


def picture(seed: int, shape=(12, 16, 3)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def packed(image: np.ndarray, suffix: str = ".png") -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


def stereo(n: int = 4) -> list:
    """Raw images of the left camera, PNGs of the right, 0.1 s apart, with messages of another type between."""
    items = []
    for i in range(n):
        at = T0_NS + i * 100_000_000
        items += [
            RawImage("/left/image_raw", at, picture(i)),
            PackedImage("/right/image/compressed", at + 7, packed(picture(100 + i)), "png"),
            Text("/notes", at + 8),
        ]
    return items


TOPICS = {"/left/image_raw": "left", "/right/image/compressed": "right"}


def all_of(source, start: int = 0):
    return list(source.frames(start))


@pytest.mark.parametrize("kind", KINDS)
def test_both_message_types_come_back(tmp_path, kind):
    source = open_frames(write_bag(tmp_path, kind, stereo()), topics=TOPICS)
    frames = all_of(source)
    assert isinstance(source, BagFrames)
    assert source.cameras == ("left", "right")
    assert source.n_frames == len(frames) == 8
    assert [frame.index for frame in frames] == list(range(8))
    assert [frame.camera for frame in frames] == ["left", "right"] * 4
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, picture(i // 2 + 100 * (i % 2)))
        assert frame.image.dtype == np.uint8
        assert frame.image.flags.writeable
        exact_ns = T0_NS + (i // 2) * 100_000_000 + 7 * (i % 2)
        assert frame.stamp_s == exact_ns / 10**9  # one correctly rounded division
        assert f":{i} (" in frame.source


@pytest.mark.parametrize("kind", KINDS)
def test_resumes_at_every_frame(tmp_path, kind):
    items = stereo()
    for item in items[:6]:  # several messages in one nanosecond of recording
        item.received_ns = T0_NS + 9
    source = pickle.loads(pickle.dumps(open_frames(write_bag(tmp_path, kind, items), topics=TOPICS)))
    whole = all_of(source)
    for start in range(len(whole) + 2):
        rest = all_of(source, start)
        assert [(f.index, f.stamp_s, f.camera) for f in rest] == [(f.index, f.stamp_s, f.camera) for f in whole[start:]]
        for one, other in zip(rest, whole[start:], strict=True):
            np.testing.assert_array_equal(one.image, other.image)


def test_a_single_mcap_file_and_a_single_database(tmp_path):
    for kind, suffix in (("mcap", "*.mcap"), ("sqlite3", "*.db3")):
        folder = write_bag(tmp_path, kind, stereo())
        (file,) = folder.glob(suffix)
        assert len(all_of(open_frames(file, topics=TOPICS))) == 8
        (folder / "metadata.yaml").unlink()
        with pytest.raises(DetectError, match=rf"without metadata.yaml.*{file.name}"):
            open_frames(folder, topics=TOPICS)


@pytest.mark.parametrize(
    ("kind", "compression"), [("ros1", "BZ2"), ("ros1", "LZ4"), ("sqlite3", "FILE"), ("sqlite3", "MESSAGE")]
)
def test_compressed_bags(tmp_path, kind, compression):
    frames = all_of(open_frames(write_bag(tmp_path, kind, stereo(), compression=compression), topics=TOPICS))
    np.testing.assert_array_equal(frames[6].image, picture(3))


@pytest.mark.parametrize("definition", ["", "no message definition at all !"])
@pytest.mark.parametrize("kind", KINDS)
def test_definitions_in_the_bag_are_not_needed(tmp_path, kind, definition):
    frames = all_of(open_frames(write_bag(tmp_path, kind, stereo(), definition=definition), topics=TOPICS))
    np.testing.assert_array_equal(frames[-1].image, picture(103))


def test_the_only_image_topic_needs_no_name(tmp_path):
    path = write_bag(tmp_path, "ros1", [item for item in stereo() if not isinstance(item, PackedImage)])
    assert open_frames(path).cameras == ("cam0",)
    assert [f.camera for f in open_frames(path, camera="front")] == ["front"] * 4


def test_without_header_stamps_the_time_of_recording_counts(tmp_path):
    path = write_bag(tmp_path, "mcap", [RawImage("/a", 0, picture(i), received_ns=T0_NS + i) for i in range(3)])
    with pytest.warns(InputWarning, match=r"no stamp.*time of recording") as caught:
        frames = all_of(open_frames(path))
    assert len(caught) == 1
    assert [frame.stamp_s for frame in frames] == [(T0_NS + i) / 10**9 for i in range(3)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_of_the_same_name_and_another_layout(tmp_path, kind):
    path = write_bag(tmp_path, kind, [RawImage("/a", T0_NS, picture(0))], digest="0123456789abcdef")
    with pytest.raises(DetectError, match=r"'/a': checksum 0123456789abcdef of sensor_msgs/msg/Image, expected "):
        open_frames(path)


def test_other_encodings_of_messages(tmp_path):
    folder = write_bag(tmp_path, "mcap", [RawImage("/a", T0_NS, picture(0))], encoding="json")
    with pytest.raises(DetectError, match=r"'/a' is encoded as 'json', expected cdr"):
        open_frames(next(folder.glob("*.mcap")))
    with pytest.raises(DetectError, match="cannot be opened as a bag: Serialization format"):
        open_frames(folder)


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        ({"/left": "left"}, r"no topic '/left'.*\n  /left/image_raw  sensor_msgs/msg/Image, 4 messages\n"),
        ({"/notes": "left"}, r"'/notes' is of type std_msgs/msg/String.*\n  /left/image_raw"),
        (None, r"several image topics.*\n  /left/image_raw.*\n  /right/image/compressed"),
        ({}, "no topics are named"),
        ({"/left/image_raw": "left", "/unused": "right"}, r"topic '/unused' holds no message.*\n  /left/image_raw"),
    ],
)
def test_topics_that_do_not_fit_list_those_that_would(tmp_path, topics, message):
    with pytest.raises(DetectError, match=message):
        open_frames(write_bag(tmp_path, "ros1", [*stereo(), Unused("/unused")]), topics=topics)


def test_bags_without_images():
    bags = data_root() / "bags"
    for name in ("ROS_example.bag", "nav2_turtlebot.mcap"):
        with pytest.raises(DetectError, match="no topic of images"):
            open_frames(bags / name)


def test_unreadable_images_are_named_or_counted(tmp_path):
    items = [RawImage("/a", T0_NS + i, picture(i)) for i in range(4)]
    items[1] = RawImage("/a", T0_NS + 1, picture(1), encoding="32FC1")
    path = write_bag(tmp_path, "sqlite3", items)
    with pytest.raises(DetectError, match=r":1 \(/a\): encoding '32FC1', expected one of mono8"):
        all_of(open_frames(path))
    source = open_frames(path, on_bad="skip")
    with pytest.warns(InputWarning, match="32FC1"):
        frames = all_of(source)
    assert [frame.index for frame in frames] == [0, 2, 3]
    assert list(source.bad) == [1]
    assert source.n_frames == 4


def test_a_bag_damaged_in_the_middle(tmp_path):
    """What is before the damage is read; then comes one message, with what is left."""
    items = [RawImage("/a", T0_NS + i, np.zeros((700, 900, 3), np.uint8)) for i in range(3)]
    for item in items:
        item.pixels[:20] = picture(3, (20, 900, 3))
    path = write_bag(tmp_path, "ros1", items, compression="BZ2")  # one chunk an image
    data = bytearray(path.read_bytes())
    second = data.index(b"compression=", data.index(b"compression=") + 12)
    data[second + 100 : second + 160] = b"\xff" * 60
    path.write_bytes(bytes(data))
    source = open_frames(path, on_bad="skip")
    with pytest.warns(InputWarning, match=r"damaged after 1 of its 3 images \(.*left out"):
        frames = all_of(source)
    assert [frame.index for frame in frames] == [0]
    assert list(source.bad) == [1]
    with pytest.raises(DetectError, match="damaged after 1 of its 3"):
        all_of(open_frames(path))


@pytest.mark.parametrize("kind", KINDS)
def test_bags_that_were_cut_off(tmp_path, kind):
    path = write_bag(tmp_path, kind, stereo())
    file = path if kind == "ros1" else next(p for p in path.iterdir() if p.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    with pytest.raises(DetectError, match=r"cannot be opened as a bag.*(reindex|recover)|damaged after"):
        all_of(open_frames(path, topics=TOPICS))


def test_other_files(tmp_path):
    (tmp_path / "old.bag.bz2").write_bytes(b"BZh9")
    (tmp_path / "text.bag").write_text("hello\n")
    for name, message in (
        ("old.bag.bz2", r"old\.bag\.bz2: suffix '\.bz2'.*Unpack it first"),
        ("text.bag", "cannot be opened as a bag: File magic is invalid"),
    ):
        with pytest.raises(DetectError, match=message):
            open_frames(tmp_path / name)
    with pytest.raises(DetectError, match="no such bag"):
        open_frames(tmp_path / "none.bag", kind="bag")


def test_rosbags_missing(tmp_path, monkeypatch):
    path = write_bag(tmp_path, "ros1", stereo(1))
    monkeypatch.setitem(__import__("sys").modules, "rosbags.rosbag1", None)
    with pytest.raises(DetectError, match=r"pip install 'jaxgeo\[ros\]'"):
        open_frames(path, topics=TOPICS)


def test_a_ros2_bag_folder_named_like_a_ros1_bag(tmp_path):
    path = write_bag(tmp_path, "mcap", stereo()).rename(tmp_path / "session.bag")
    assert len(all_of(open_frames(path, topics=TOPICS))) == 8


def test_only_what_is_asked_for_is_read(tmp_path, monkeypatch):
    """Neither the bag as a whole, nor, of a ROS 1 bag, the images before the start."""
    n_bytes = 700 * 900 * 3
    path = write_bag(tmp_path, "ros1", [RawImage("/a", T0_NS + i, picture(i, (700, 900, 3))) for i in range(5)])
    source = open_frames(path)
    read = []

    class Counted:
        def __init__(self, file):
            self.file = file

        def __getattr__(self, name):
            return getattr(self.file, name)

        def read(self, n=-1):
            data = self.file.read(n)
            read.append(len(data))
            return data

    opened = Path.open
    monkeypatch.setattr(Path, "open", lambda self, *args, **named: Counted(opened(self, *args, **named)))
    for start in (0, 4):
        read.clear()
        assert next(source.frames(start)).index == start
        assert n_bytes < sum(read) < 1.5 * n_bytes
