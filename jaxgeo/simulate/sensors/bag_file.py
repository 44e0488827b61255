"""A simulated recording as a ROS 2 bag (MCAP), as a rig's drivers would write it. rosbags' writer lives here."""

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from jaxgeo.data import Camera
from jaxgeo.data.scan import Scan
from jaxgeo.errors import InputError
from jaxgeo.io.atomic import output_folder
from jaxgeo.io.yaml_text import dump_yaml
from jaxgeo.simulate.sensors.files import recording_config, write_side_files
from jaxgeo.simulate.sensors.recording import DEPTH_UNIT_M, EncodedFrame, Recording
from jaxgeo.simulate.sensors.rendering import rendered
from jaxgeo.simulate.sensors.rig import CAMERA
from jaxgeo.simulate.session import START_S

BAG = "bag"
SCANS, COLOR, DEPTH = "/lidar/points", "/camera/color/image_raw/compressed", "/camera/aligned_depth/image_raw"
COLOR_INFO, TF_STATIC = "/camera/color/camera_info", "/tf_static"
BODY_FRAME, LIDAR_FRAME, CAMERA_FRAME = "body", "lidar", "camera_color_optical_frame"
_TYPES = {
    SCANS: "sensor_msgs/msg/PointCloud2",
    COLOR: "sensor_msgs/msg/CompressedImage",
    DEPTH: "sensor_msgs/msg/Image",
    COLOR_INFO: "sensor_msgs/msg/CameraInfo",
    TF_STATIC: "tf2_msgs/msg/TFMessage",
}
_FLOAT32 = 7  # of sensor_msgs/PointField
_FIELDS = ("x", "y", "z", "intensity", "time")


def write_recording_bag(
    recording: Recording, folder: Path, *, workers: int = 1, on_item: Callable[[], None] = lambda: None
) -> Path:
    """Render a recording into a bag in `folder`, beside it what `write_side_files` writes; the config's path.

    Points carry their seconds after the scan's stamp (`time`); depth is 16UC1 in millimetres on the colour's pixels.

    Args:
        on_item: called after each scan and each frame.

    Raises:
        InputError: rosbags is not installed, or there is a bag already.
    """
    if (folder / BAG).exists():
        raise InputError(f"{folder / BAG}: there is a bag already. Remove it, or name another folder.")
    rosbags = _rosbags()
    with output_folder(folder) as temporary:
        with rosbags.writer(temporary / BAG) as writer:
            topics = _TYPES if recording.camera is not None else {name: _TYPES[name] for name in (SCANS, TF_STATIC)}
            channels = {
                topic: writer.add_connection(topic, kind, typestore=rosbags.types) for topic, kind in topics.items()
            }
            messages = _Messages(rosbags.types.types, recording)
            for topic, stamp_ns, message in messages.of(rendered(recording, workers), on_item):
                data = rosbags.types.serialize_cdr(message, _TYPES[topic])
                writer.write(channels[topic], stamp_ns, data)
        write_side_files(recording, temporary)
        frames = {"kind": "bag", "path": BAG, "topics": {COLOR: CAMERA}}
        config = recording_config(recording, {"path": BAG, "kind": "bag", "topic": SCANS}, frames)
        if recording.camera is not None:
            depth = {"topics": {"color": COLOR, "depth": DEPTH}, "camera": CAMERA, "depth_unit_m": DEPTH_UNIT_M}
            config["rgbd"] = {"path": BAG, "kind": "bag", **depth}
        (temporary / "config.yaml").write_text(dump_yaml(config), encoding="utf-8")
    return folder / "config.yaml"


class _Messages:
    """Scans and frames as ROS messages."""

    def __init__(self, types: Any, recording: Recording) -> None:
        self._make = {name.rsplit("/", 1)[-1]: kind for name, kind in types.items()}
        self._recording = recording

    def of(self, items: Iterable[Scan | EncodedFrame], on_item: Callable[[], None]) -> Iterable[tuple[str, int, Any]]:
        """Topic, stamp in nanoseconds and message, the sensors' places first."""
        yield TF_STATIC, _nanoseconds(START_S), self._places()
        for item in items:
            stamp_ns = _nanoseconds(item.stamp_s)
            if isinstance(item, Scan):
                yield SCANS, stamp_ns, self._cloud(item)
            else:
                yield COLOR_INFO, stamp_ns, self._lens(item.stamp_s, self._recording.rig.camera)
                yield COLOR, stamp_ns, self._color(item)
                yield DEPTH, stamp_ns, self._depth(item)
            on_item()

    def _header(self, stamp_s: float, frame: str) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(stamp_s), 10**9)
        return self._make["Header"](self._make["Time"](seconds, nanoseconds), frame)

    def _cloud(self, scan: Scan) -> Any:
        assert scan.time_s is not None
        assert scan.intensity is not None
        rows = np.column_stack([scan.points_m, scan.intensity, scan.time_s]).astype("<f4")
        fields = [self._make["PointField"](name, 4 * i, _FLOAT32, 1) for i, name in enumerate(_FIELDS)]
        step = 4 * len(_FIELDS)
        data = rows.view(np.uint8).reshape(-1)
        header = self._header(scan.stamp_s, LIDAR_FRAME)
        return self._make["PointCloud2"](header, 1, len(scan), fields, False, step, step * len(scan), data, True)

    def _color(self, frame: EncodedFrame) -> Any:
        header = self._header(frame.stamp_s, CAMERA_FRAME)
        data = np.frombuffer(frame.color_jpeg, np.uint8)
        return self._make["CompressedImage"](header, "bgr8; jpeg compressed bgr8", data)

    def _depth(self, frame: EncodedFrame) -> Any:
        depth = cv2.imdecode(np.frombuffer(frame.depth_png, np.uint8), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        height, width = depth.shape
        data = depth.astype("<u2").view(np.uint8).reshape(-1)
        header = self._header(frame.stamp_s, CAMERA_FRAME)
        return self._make["Image"](header, height, width, "16UC1", 0, 2 * width, data)

    def _lens(self, stamp_s: float, camera: Camera) -> Any:
        fx, fy, cx, cy = camera.intrinsics_px
        assert camera.resolution_px is not None
        width, height = camera.resolution_px
        d = np.zeros(5)
        d[: len(camera.distortion)] = camera.distortion
        k = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1])
        p = np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0])
        whole = self._make["RegionOfInterest"](0, 0, 0, 0, False)
        header = self._header(stamp_s, CAMERA_FRAME)
        return self._make["CameraInfo"](header, height, width, "plumb_bob", d, k, np.eye(3).ravel(), p, 0, 0, whole)

    def _places(self) -> Any:
        rig = self._recording.rig
        frames = {LIDAR_FRAME: rig.T_body_lidar}
        if self._recording.camera is not None:
            frames[CAMERA_FRAME] = rig.T_body_cam
        return self._make["TFMessage"]([self._place(frame, pose) for frame, pose in frames.items()])

    def _place(self, frame: str, pose: RigidTransform) -> Any:
        transform = self._make["Transform"](
            self._make["Vector3"](*map(float, pose.translation)),
            self._make["Quaternion"](*map(float, pose.rotation.as_quat(canonical=True))),
        )
        return self._make["TransformStamped"](self._header(START_S, BODY_FRAME), frame, transform)


def _nanoseconds(stamp_s: float) -> int:
    """Through whole microseconds: a float64 of today's seconds holds no more."""
    return round(stamp_s * 1e6) * 1000


class _Rosbags:
    """What of the library is used here."""

    def __init__(self, rosbag2: Any, types: Any) -> None:
        self._rosbag2 = rosbag2
        self.types = types

    def writer(self, path: Path) -> Any:
        writer = self._rosbag2.Writer(path, version=9, storage_plugin=self._rosbag2.StoragePlugin.MCAP)
        writer.set_compression(self._rosbag2.CompressionMode.STORAGE, self._rosbag2.CompressionFormat.ZSTD)
        return writer


@functools.cache
def _rosbags() -> _Rosbags:
    """The library, or a refusal that says how to install it."""
    try:
        from rosbags import rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError as failure:
        raise InputError(
            f"writing a ROS 2 bag needs rosbags, which cannot be imported ({failure}): pip install 'jaxgeo[ros]'."
        ) from None
    return _Rosbags(rosbag2, get_typestore(Stores.ROS2_HUMBLE))
