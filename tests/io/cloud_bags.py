"""Writes small bags of point clouds for tests: ROS 1, ROS 2 (SQLite, MCAP)."""

import dataclasses
from pathlib import Path

import numpy as np
from bags import STORES
from rosbags import rosbag1, rosbag2

DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
NAME = "sensor_msgs/msg/PointCloud2"


@dataclasses.dataclass
class Cloud:
    """A sensor_msgs/PointCloud2: a structured array of one row or of several, with `pad` bytes behind each row."""

    topic: str
    stamp_ns: int
    points: np.ndarray
    pad: int = 0
    received_ns: int | None = None


def cloud_message(store, cloud: Cloud):
    points = np.atleast_2d(cloud.points)
    height, width = points.shape
    step = points.dtype.itemsize
    row = np.frombuffer(points.tobytes(), np.uint8).reshape(height, width * step)
    padded = np.full((height, width * step + cloud.pad), 77, np.uint8)
    padded[:, : width * step] = row
    field = store.types["sensor_msgs/msg/PointField"]
    fields = [
        field(name=name, offset=offset, datatype=DATATYPES[kind.str[1:]], count=1)
        for name, (kind, offset) in points.dtype.fields.items()
    ]
    big = any(kind.str[0] == ">" for kind, _ in points.dtype.fields.values())
    stamp = store.types["builtin_interfaces/msg/Time"](sec=cloud.stamp_ns // 10**9, nanosec=cloud.stamp_ns % 10**9)
    seq = {"seq": 0} if store is STORES["ros1"] else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar", **seq)
    return store.types[NAME](header, height, width, fields, big, step, width * step + cloud.pad, padded.ravel(), False)


def write_cloud_bag(folder: Path, kind: str, clouds: list[Cloud], name: str = "clouds") -> Path:
    """A bag (kinds as in `bags.KINDS`) with these messages; its path."""
    store = STORES["ros1" if kind == "ros1" else "ros2"]
    if kind == "ros1":
        path = folder / f"{name}.bag"
        writer = rosbag1.Writer(path)
    else:
        path = folder / f"{name}_{kind}"
        writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[kind.upper()])
    with writer:
        connections = {}
        for cloud in clouds:
            if cloud.topic not in connections:
                connections[cloud.topic] = writer.add_connection(cloud.topic, NAME, typestore=store)
            raw = (store.serialize_ros1 if kind == "ros1" else store.serialize_cdr)(cloud_message(store, cloud), NAME)
            received_ns = cloud.received_ns if cloud.received_ns is not None else cloud.stamp_ns + 5_000_000
            writer.write(connections[cloud.topic], received_ns, raw)
    return path
