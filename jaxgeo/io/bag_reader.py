"""ROS 1 bags, ROS 2 bags (SQLite or MCAP) and single MCAP files: the messages of chosen topics. rosbags lives here.

The messages read here (images, point clouds) have had one layout in all releases of ROS, so they are read with rosbags'
own definitions: bags without definitions open like others, and a broken definition of some other topic does no harm.
Their checksums, where the bag has them, are compared.
"""

import contextlib
import dataclasses
import functools
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from jaxgeo.errors import InputError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.regular_file import check_regular

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
_ROS1_MAGIC = b"#ROSBAG V"


@dataclasses.dataclass(frozen=True)
class MessageKind:
    """What is to be read from a bag, and how messages speak of it.

    Attributes:
        noun: what one message holds: `image`, `scan`.
        types: names of the message types that hold it.
        choice: how the caller chooses topics.
        device: whose driver fills the messages.
        error: raised where the bag or a topic is unusable.
        unreadable: raised where one message is.
    """

    noun: str
    types: tuple[str, ...]
    choice: str
    device: str
    error: type[InputError]
    unreadable: type[InputError]


@dataclasses.dataclass(frozen=True)
class BagMessage:
    """One message.

    Attributes:
        index: its place among the messages of the chosen topics, counted from 0.
        topic: where it was sent.
        msgtype: name of its type.
        stamp_s: of its header; without one, the time of recording.
        content: the deserialised message.
        source: file, place and topic, for messages.
    """

    index: int
    topic: str
    msgtype: str
    stamp_s: float
    content: Any
    source: str


class BagReader:
    """The messages of some topics of a bag, in the order in which they were recorded. Holds no open file.

    Attributes:
        path: the bag.
        topics: the chosen ones.
        n_messages: how many messages the bag announces for them.
    """

    def __init__(self, path: str | Path, topics: Sequence[str] | None, kind: MessageKind) -> None:
        """Open the bag once and look at its topics.

        Args:
            path: a `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
            topics: default: the only one with messages of this kind.
            kind: what is to be read.

        Raises:
            kind.error: rosbags is not installed; no such bag, or a damaged one; a topic is missing, of another type or
                empty; several topics and no choice.
        """
        self.path = Path(path)
        self._kind = kind
        _check_path(self.path, kind)
        with _opened(self.path, kind) as reader:
            self.topics = tuple(topics) if topics is not None else (self._only_topic(reader),)
            self.n_messages = sum(connection.msgcount for connection in self._connections(reader))

    def entries(self, start: int = 0) -> Iterator[tuple[int, Callable[[], BagMessage]]]:
        """(index, what reads it) of the messages from `start` on.

        Where the bag ends before its index says so, or is damaged, the last entry raises. Reading raises
        `kind.unreadable`, and warns (InputWarning) of the first message of a topic without a header stamp.
        """
        unstamped: set[str] = set()
        with _opened(self.path, self._kind) as reader:
            connections = self._connections(reader)
            deserialize = _deserializer(self.path, self._kind)
            messages = _messages_from(reader, connections, start)
            for index in range(start, self.n_messages):
                try:
                    message = next(messages, None)
                except Exception as failure:
                    yield index, functools.partial(self._ends, index, f" ({_told(failure)})")
                    return
                if message is None:
                    yield index, functools.partial(self._ends, index, "")
                    return
                yield index, functools.partial(self._message, index, message, deserialize, unstamped)

    def _message(
        self, index: int, message: tuple[Any, int, bytes], deserialize: Callable[..., Any], unstamped: set[str]
    ) -> BagMessage:
        connection, received_ns, raw = message
        source = f"{self.path}:{index} ({connection.topic})"
        try:
            content = deserialize(raw, connection.msgtype)
        except Exception as failure:
            raise self._kind.unreadable(f"{source}: the message is damaged: {_told(failure)}.") from None
        stamp_ns = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec
        if stamp_ns == 0 and connection.topic not in unstamped:
            unstamped.add(connection.topic)
            warnings.warn(
                f"{source}: the header has no stamp (0); the time of recording is used, which comes later by an "
                f"unknown delay. Have the {self._kind.device}'s driver set header.stamp.",
                InputWarning,
                stacklevel=5,
            )
        # Whole numbers divided once: the nearest float64 to the exact seconds
        stamp_s = (stamp_ns or received_ns) / 10**9
        return BagMessage(index, connection.topic, connection.msgtype, stamp_s, content, source)

    def _ends(self, index: int, why: str) -> NoReturn:
        raise self._kind.unreadable(
            f"{self.path}: the bag ends or is damaged after {index} of its {self.n_messages} {self._kind.noun}s{why}. "
            "Copy it again, or repair it (`rosbag reindex`, `ros2 bag reindex`, `mcap recover`)."
        )

    def _only_topic(self, reader: Any) -> str:
        kind = self._kind
        found = _topics_of_types(reader, kind)
        if len(found) != 1:
            if found:
                problem = f"several {kind.noun} topics. Choose with {kind.choice}. Its topics:"
            else:
                problem = f"no topic of {kind.noun}s. Is it another bag? Its topics:"
            raise kind.error(f"{self.path}: {problem}\n{_listing(reader, kind)}")
        return found[0]

    def _connections(self, reader: Any) -> list[Any]:
        """The chosen topics' connections, one for each publisher."""
        path, kind = self.path, self._kind
        found = []
        for topic in self.topics:
            of_topic = [connection for connection in reader.connections if connection.topic == topic]
            if not of_topic:
                raise kind.error(f"{path}: no topic {topic!r}. Name one of the bag's own:\n{_listing(reader, kind)}")
            other = next((connection for connection in of_topic if connection.msgtype not in kind.types), None)
            if other is not None:
                raise kind.error(
                    f"{path}: topic {topic!r} is of type {other.msgtype}, expected {' or '.join(kind.types)}. Name one "
                    f"of the bag's {kind.noun} topics:\n{_listing(reader, kind)}"
                )
            if not any(connection.msgcount for connection in of_topic):
                raise kind.error(f"{path}: topic {topic!r} holds no message. Name another:\n{_listing(reader, kind)}")
            found += of_topic
        _check_layout(path, found, kind)
        return found


def topics_of_types(path: str | Path, kind: MessageKind) -> tuple[list[str], str]:
    """The topics of a bag with messages of this kind, and a listing of all its topics for messages.

    Raises:
        kind.error: rosbags is not installed; no such bag, or a damaged one.
    """
    _check_path(Path(path), kind)
    with _opened(Path(path), kind) as reader:
        return _topics_of_types(reader, kind), _listing(reader, kind)


def _topics_of_types(reader: Any, kind: MessageKind) -> list[str]:
    return sorted({c.topic for c in reader.connections if c.msgtype in kind.types and c.msgcount})


@contextlib.contextmanager
def _opened(path: Path, kind: MessageKind) -> Iterator[Any]:
    """The bag's index, and access to its messages; nothing of them is read yet."""
    rosbags = _rosbags(path, kind.error)
    part = rosbags.rosbag1 if _is_ros1(path) else rosbags.rosbag2
    try:
        reader = part.Reader(path)
        reader.open()
        if not all(isinstance(connection.msgcount, int) for connection in reader.connections):
            raise ValueError("a topic's count of messages is no number")
    except Exception as failure:  # of a damaged file: ReaderError, struct.error, AssertionError, errors of SQLite, …
        raise kind.error(f"{path}: cannot be opened as a bag: {_told(failure)}. {_repair(path)}") from None
    try:
        yield reader
    finally:
        reader.close()


def _check_path(path: Path, kind: MessageKind) -> None:
    if not path.exists():
        raise kind.error(f"{path}: no such bag. Check the path (in a config: relative to the config file).")
    check_regular(path, kind.error)
    if path.is_dir() and not (path / "metadata.yaml").exists():
        inside = sorted(p.name for p in path.iterdir() if p.suffix in BAG_SUFFIXES)
        hint = f"Name one of {', '.join(inside[:5])}." if inside else "Is it the folder of a ROS 2 bag?"
        raise kind.error(f"{path}: a folder without metadata.yaml, expected that of a ROS 2 bag. {hint}")
    if path.is_file() and path.suffix not in BAG_SUFFIXES:
        packed = path.suffix in (".bz2", ".gz", ".zst", ".zip", ".7z", ".xz")
        hint = " Unpack it first." if packed else ""
        raise kind.error(f"{path}: suffix {path.suffix!r}, expected .bag, .mcap, .db3 or the folder of a bag.{hint}")

    if _is_ros1(path):  # in a binary file of another kind rosbags would look for the end of the first line to its end
        with path.open("rb") as file:
            head = file.read(len(_ROS1_MAGIC))
        if b"\0" in head and head != _ROS1_MAGIC:
            raise kind.error(
                f"{path}: cannot be opened as a bag: it begins with {head!r}, expected {_ROS1_MAGIC!r}. {_repair(path)}"
            )


def _told(failure: Exception) -> str:
    """What rosbags says, which may quote the whole of what it could not read."""
    return " ".join(str(failure).split())[:200].rstrip(".")


def _repair(path: Path) -> str:
    if _is_ros1(path):
        return "Was recording cut off? `rosbag reindex` mends that."
    if path.suffix == ".mcap":
        return "Was recording cut off? `mcap recover` mends that. Only MCAPs that ROS 2 wrote (profile ros2) are read."
    return "Was recording cut off? `ros2 bag reindex` mends that."


def _is_ros1(path: Path) -> bool:
    return path.suffix == ".bag" and path.is_file()  # folders of ROS 2 bags are sometimes named like it


def _rosbags(path: Path, error: type[InputError]) -> Any:
    try:
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ImportError as failure:
        raise error(
            f"{path}: reading bags needs rosbags, which cannot be imported ({failure}): pip install 'jaxgeo[ros]'."
        ) from None
    return rosbags


def _typestore(path: Path, kind: MessageKind) -> Any:
    typesys = _rosbags(path, kind.error).typesys
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC if _is_ros1(path) else typesys.Stores.ROS2_HUMBLE)


def _deserializer(path: Path, kind: MessageKind) -> Callable[[bytes, str], Any]:
    store = _typestore(path, kind)
    return store.deserialize_ros1 if _is_ros1(path) else store.deserialize_cdr


def _check_layout(path: Path, connections: Sequence[Any], kind: MessageKind) -> None:
    store = _typestore(path, kind)
    for connection in connections:
        if _is_ros1(path):
            known = store.generate_msgdef(connection.msgtype)[1]
        else:
            known = store.hash_rihs01(connection.msgtype)
            encoding = connection.ext.serialization_format
            if encoding != "cdr":
                raise kind.error(
                    f"{path}: topic {connection.topic!r} is encoded as {encoding!r}, expected cdr (ROS 2)."
                )
        if connection.digest not in ("", "*", known):
            raise kind.error(
                f"{path}: topic {connection.topic!r}: checksum {connection.digest} of {connection.msgtype}, expected "
                f"{known}: a message of that name with another layout. Convert the bag to the standard message."
            )


def _listing(reader: Any, kind: MessageKind) -> str:
    topics = {(c.topic, c.msgtype): 0 for c in reader.connections}
    for connection in reader.connections:
        topics[connection.topic, connection.msgtype] += connection.msgcount
    # Those of the kind first: what the reader of the message is after
    order = sorted(topics.items(), key=lambda item: (item[0][1] not in kind.types, item[0]))
    return "\n".join(f"  {topic}  {name}, {n} messages" for (topic, name), n in order) or "  (the bag has no topics)"


def _messages_from(reader: Any, connections: list[Any], start: int) -> Iterator[tuple[Any, int, bytes]]:
    """(connection, time of recording in ns, raw message), without the first `start`.

    The index of a ROS 1 bag tells the time from which to read. Other bags are read from their start, but their messages
    are not deserialised.
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
