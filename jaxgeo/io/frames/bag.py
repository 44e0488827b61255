"""ROS 1 bags, ROS 2 bags (SQLite or MCAP) and single MCAP files. rosbags lives here.

The two image messages have had one layout in all releases of ROS, so they are read with rosbags' own definitions: bags
without definitions open like others, and a broken definition of some other topic does no harm. Their checksums, where
the bag has them, are compared.
"""

import contextlib
import functools
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from jaxgeo.errors import DetectError
from jaxgeo.io.frames.frame import DEFAULT_CAMERA, Frame, FrameSource, OnBad, UnreadableImageError
from jaxgeo.io.frames.image_message import image_of_compressed_message, image_of_message
from jaxgeo.io.input_warning import InputWarning

READERS = {
    "sensor_msgs/msg/Image": image_of_message,
    "sensor_msgs/msg/CompressedImage": image_of_compressed_message,
}


class BagFrames(FrameSource):
    """The images of some topics of a bag, in the order in which they were recorded, read one by one.

    Their stamps are those of the message headers. Images without (stamp 0) get the time of recording, with a warning.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        topics: Mapping[str, str] | None = None,
        camera: str | None = None,
        on_bad: OnBad = "raise",
    ) -> None:
        """Open the bag once and look at its topics.

        Args:
            path: a `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
            topics: topic -> camera; topics of one camera are allowed. Default: the only image topic.
            camera: the camera of the only image topic, without `topics`; default `cam0`.
            on_bad: as of every source.

        Raises:
            DetectError: rosbags is not installed; no such bag, or a damaged one; a topic is missing, is no image or
                holds none; several image topics and no choice.
        """
        self._path = Path(path)
        _check_path(self._path)
        with _opened(self._path) as reader:
            if topics is None:
                topics = {_only_image_topic(path, reader): camera or DEFAULT_CAMERA}
            if not topics:
                raise DetectError(f"{path}: no topics are named, expected at least one (topic: camera).")
            connections = _connections(path, reader, topics)
        self._topics = dict(topics)
        cameras = tuple(dict.fromkeys(self._topics.values()))
        super().__init__(cameras, sum(connection.msgcount for connection in connections), on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Frame]]]:
        unstamped: set[str] = set()
        with _opened(self._path) as reader:
            connections = _connections(self._path, reader, self._topics)
            deserialize = _deserializer(self._path)
            messages = _messages_from(reader, connections, start)
            for index in range(start, self.n_frames or 0):
                try:
                    message = next(messages, None)
                except Exception as failure:
                    yield index, functools.partial(self._ends, index, f" ({str(failure).rstrip('.')})")
                    return
                if message is None:
                    yield index, functools.partial(self._ends, index, "")
                    return
                yield index, functools.partial(self._frame, index, message, deserialize, unstamped)

    def _frame(
        self, index: int, message: tuple[Any, int, bytes], deserialize: Callable[..., Any], unstamped: set[str]
    ) -> Frame:
        connection, received_ns, raw = message
        source = f"{self._path}:{index} ({connection.topic})"
        try:
            content = deserialize(raw, connection.msgtype)
        except Exception as failure:
            raise UnreadableImageError(f"{source}: the message is damaged: {str(failure).rstrip('.')}.") from None
        stamp_ns = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec
        if stamp_ns == 0 and connection.topic not in unstamped:
            unstamped.add(connection.topic)
            warnings.warn(
                f"{source}: the header has no stamp (0); the time of recording is used, which comes later by an "
                "unknown delay. Have the camera's driver set header.stamp.",
                InputWarning,
                stacklevel=4,
            )
        image = READERS[connection.msgtype](content, source)
        # Whole numbers divided once: the nearest float64 to the exact seconds
        stamp_s = (stamp_ns or received_ns) / 10**9
        return Frame(stamp_s, self._topics[connection.topic], source, index, image)

    def _ends(self, index: int, why: str) -> NoReturn:
        raise UnreadableImageError(
            f"{self._path}: the bag ends or is damaged after {index} of its {self.n_frames} images{why}. Copy it "
            "again, or repair it (`rosbag reindex`, `ros2 bag reindex`, `mcap recover`)."
        )

    def _name(self) -> str:
        return str(self._path)


def _check_path(path: Path) -> None:
    if not path.exists():
        raise DetectError(f"{path}: no such bag. Check the path (in a config: relative to the config file).")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        inside = sorted(p.name for p in path.iterdir() if p.suffix in (".bag", ".mcap", ".db3"))
        hint = f"Name one of {', '.join(inside[:5])}." if inside else "Is it the folder of a ROS 2 bag?"
        raise DetectError(f"{path}: a folder without metadata.yaml, expected that of a ROS 2 bag. {hint}")
    if path.is_file() and path.suffix not in (".bag", ".mcap", ".db3"):
        packed = path.suffix in (".bz2", ".gz", ".zst", ".zip", ".7z", ".xz")
        hint = " Unpack it first." if packed else ""
        raise DetectError(f"{path}: suffix {path.suffix!r}, expected .bag, .mcap, .db3 or the folder of a bag.{hint}")


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The bag's index, and access to its messages; nothing of them is read yet."""
    rosbags = _rosbags(path)
    part = rosbags.rosbag1 if _is_ros1(path) else rosbags.rosbag2
    try:
        reader = part.Reader(path)
        reader.open()
    except Exception as failure:  # of a damaged file: ReaderError, struct.error, AssertionError, errors of SQLite, …
        raise DetectError(f"{path}: cannot be opened as a bag: {str(failure).rstrip('.')}. {_repair(path)}") from None
    try:
        yield reader
    finally:
        reader.close()


def _repair(path: Path) -> str:
    if _is_ros1(path):
        return "Was recording cut off? `rosbag reindex` mends that."
    if path.suffix == ".mcap":
        return "Was recording cut off? `mcap recover` mends that. Only MCAPs that ROS 2 wrote (profile ros2) are read."
    return "Was recording cut off? `ros2 bag reindex` mends that."


def _is_ros1(path: Path) -> bool:
    return path.suffix == ".bag" and path.is_file()  # folders of ROS 2 bags are sometimes named like it


def _rosbags(path: Path) -> Any:
    try:
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ImportError as failure:
        raise DetectError(
            f"{path}: reading bags needs rosbags, which cannot be imported ({failure}): pip install 'jaxgeo[ros]'."
        ) from None
    return rosbags


def _typestore(path: Path) -> Any:
    typesys = _rosbags(path).typesys
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC if _is_ros1(path) else typesys.Stores.ROS2_HUMBLE)


def _deserializer(path: Path) -> Callable[[bytes, str], Any]:
    store = _typestore(path)
    return store.deserialize_ros1 if _is_ros1(path) else store.deserialize_cdr


def _only_image_topic(path: str | Path, reader: Any) -> str:
    images = sorted({c.topic for c in reader.connections if c.msgtype in READERS and c.msgcount})
    if len(images) != 1:
        if images:
            problem = "several image topics. Choose with `topics` (topic: camera). Its topics:"
        else:
            problem = "no topic of images. Is it another bag? Its topics:"
        raise DetectError(f"{path}: {problem}\n{_listing(reader)}")
    return images[0]


def _connections(path: str | Path, reader: Any, topics: Mapping[str, str]) -> list[Any]:
    """The chosen topics' connections, one for each publisher."""
    found = []
    for topic in topics:
        of_topic = [connection for connection in reader.connections if connection.topic == topic]
        if not of_topic:
            raise DetectError(f"{path}: no topic {topic!r}. Name one of the bag's own:\n{_listing(reader)}")
        other = next((connection for connection in of_topic if connection.msgtype not in READERS), None)
        if other is not None:
            raise DetectError(
                f"{path}: topic {topic!r} is of type {other.msgtype}, expected {' or '.join(READERS)}. Name one of the "
                f"bag's image topics:\n{_listing(reader)}"
            )
        if not any(connection.msgcount for connection in of_topic):
            raise DetectError(f"{path}: topic {topic!r} holds no message. Name another:\n{_listing(reader)}")
        found += of_topic
    _check_layout(Path(path), found)
    return found


def _check_layout(path: Path, connections: Sequence[Any]) -> None:
    store = _typestore(path)
    for connection in connections:
        if _is_ros1(path):
            known = store.generate_msgdef(connection.msgtype)[1]
        else:
            known = store.hash_rihs01(connection.msgtype)
            encoding = connection.ext.serialization_format
            if encoding != "cdr":
                raise DetectError(
                    f"{path}: topic {connection.topic!r} is encoded as {encoding!r}, expected cdr (ROS 2)."
                )
        if connection.digest not in ("", "*", known):
            raise DetectError(
                f"{path}: topic {connection.topic!r}: checksum {connection.digest} of {connection.msgtype}, expected "
                f"{known}: a message of that name with another layout. Convert the bag to the standard message."
            )


def _listing(reader: Any) -> str:
    topics = {(c.topic, c.msgtype): 0 for c in reader.connections}
    for connection in reader.connections:
        topics[connection.topic, connection.msgtype] += connection.msgcount
    # Images first: what the reader of the message is after
    order = sorted(topics.items(), key=lambda item: (item[0][1] not in READERS, item[0]))
    return "\n".join(f"  {topic}  {kind}, {n} messages" for (topic, kind), n in order) or "  (the bag has no topics)"


def _messages_from(reader: Any, connections: list[Any], start: int) -> Iterator[tuple[Any, int, bytes]]:
    """(connection, time of recording in ns, raw message), without the first `start`.

    The index of a ROS 1 bag tells the time from which to read. Other bags are read from their start, but their images
    are not decoded.
    """
    from_ns = None
    indexes = getattr(reader, "indexes", None)
    if indexes is not None and start:
        times = sorted(entry.time for connection in connections for entry in indexes[connection.id])
        if start >= len(times):
            return
        from_ns = times[start]
        start -= times.index(from_ns)  # messages of the same nanosecond come before it
    for at, message in enumerate(reader.messages(connections, start=from_ns)):
        if at >= start:
            yield message
