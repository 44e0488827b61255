"""Writes small bags of images for tests: ROS 1, ROS 2 (SQLite, MCAP)."""

import dataclasses
import re
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

KINDS = ("ros1", "sqlite3", "mcap")
STORES = {"ros1": get_typestore(Stores.ROS1_NOETIC), "ros2": get_typestore(Stores.ROS2_HUMBLE)}


@dataclasses.dataclass
class RawImage:
    """A sensor_msgs/Image to write; `step` and `received_ns` follow from the others where they are not given."""

    topic: str
    stamp_ns: int
    pixels: np.ndarray
    encoding: str = "bgr8"
    step: int | None = None
    big_endian: bool = False
    received_ns: int | None = None


@dataclasses.dataclass
class PackedImage:
    """A sensor_msgs/CompressedImage to write."""

    topic: str
    stamp_ns: int
    data: bytes
    format: str = "jpeg"
    received_ns: int | None = None


@dataclasses.dataclass
class Text:
    """A std_msgs/String to write: no image."""

    topic: str
    received_ns: int


@dataclasses.dataclass
class Unused:
    """A topic of sensor_msgs/Image without messages."""

    topic: str


Item = RawImage | PackedImage | Text | Unused


def write_bag(
    folder: Path,
    kind: str,
    items: list[Item],
    *,
    definition: str | None = None,
    digest: str | None = None,
    encoding: str | None = None,
    compression: str | None = None,
) -> Path:
    """A bag with these messages; its path.

    `definition` replaces that of every message type (`""`: none), `digest` its checksum, `encoding` the name `cdr`.
    """
    path = folder / ("images.bag" if kind == "ros1" else f"images_{kind}")
    if kind == "ros1":
        writer = rosbag1.Writer(path)
        if compression:
            writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    else:
        writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[kind.upper()])
        if compression:
            writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    store = STORES["ros1" if kind == "ros1" else "ros2"]
    with writer:
        connections = {}
        for item in items:
            name, message = _message(store, item)
            if item.topic not in connections:
                known = _definition(kind, store, name, definition, digest)
                if encoding:
                    known["serialization_format"] = encoding
                connections[item.topic] = writer.add_connection(item.topic, name, **known)
            if message is None:
                continue
            raw = (store.serialize_ros1 if kind == "ros1" else store.serialize_cdr)(message, name)
            received_ns = item.received_ns if item.received_ns is not None else item.stamp_ns + 5_000_000
            writer.write(connections[item.topic], received_ns, raw)
    if kind != "ros1" and definition == "":  # as recorders before ROS 2 Iron left it
        metadata = path / "metadata.yaml"
        metadata.write_text(re.sub(r"RIHS01_\w+", "''", metadata.read_text()))
    return path


def _definition(kind: str, store, name: str, definition: str | None, digest: str | None) -> dict[str, str]:
    known, md5sum = store.generate_msgdef(name, ros_version=1 if kind == "ros1" else 2)
    text = known if definition is None else definition
    if kind == "ros1":
        return {"msgdef": text, "md5sum": digest or md5sum}
    return {"msgdef": text, "rihs01": digest or store.hash_rihs01(name)}


def _message(store, item: Item):
    if isinstance(item, Text):
        return "std_msgs/msg/String", store.types["std_msgs/msg/String"]("hello")
    if isinstance(item, Unused):
        return "sensor_msgs/msg/Image", None
    header = _header(store, item.stamp_ns)
    if isinstance(item, PackedImage):
        name = "sensor_msgs/msg/CompressedImage"
        return name, store.types[name](header, item.format, np.frombuffer(item.data, np.uint8))
    height, width = item.pixels.shape[:2]
    row = np.ascontiguousarray(item.pixels).view(np.uint8).reshape(height, -1)
    step = item.step or row.shape[1]
    padded = np.full((height, step), 77, np.uint8)
    padded[:, : row.shape[1]] = row
    name = "sensor_msgs/msg/Image"
    return name, store.types[name](header, height, width, item.encoding, int(item.big_endian), step, padded.ravel())


def _header(store, stamp_ns: int):
    stamp = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    seq = {"seq": 0} if store is STORES["ros1"] else {}
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="optical", **seq)
