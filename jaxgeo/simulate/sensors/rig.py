"""The simulated rig: a spinning LiDAR above the body, an RGB-D camera before it."""

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Camera
from jaxgeo.simulate.layout import Layout

CAMERA = "cam0"
T_BODY_CAM_M = (0.10, 0.02, -0.04)
T_BODY_LIDAR_M = (-0.06, 0.0, 0.14)
LIDAR_TILT_RAD = np.array([0.01, 0.05, -0.02])  # roll, pitch, yaw: mounts are never square
# The camera looks down to the markers by this share of the angle at which they appear.
_DOWN_SHARE = 0.62


@dataclasses.dataclass(frozen=True)
class SensorRig:
    """Where the sensors sit, and the camera's lens.

    Attributes:
        camera: in the body frame (x forward, y left, z up).
        T_body_lidar: the LiDAR's axes are like the body's, but for the mount's tilt.
    """

    camera: Camera
    T_body_lidar: RigidTransform

    @property
    def T_body_cam(self) -> RigidTransform:
        """Pose of the optical axes (x right, y down, z forward) in the body."""
        attitude = Rotation.from_quat(self.camera.quat_body_cam_wxyz, scalar_first=True)
        return RigidTransform.from_components(self.camera.t_body_cam_m, attitude)


def sensor_rig(
    layout: Layout,
    resolution_px: tuple[int, int],
    focal_px: float,
    distortion: tuple[float, ...] = (),
) -> SensorRig:
    """The rig of a session: the camera is tilted down for a rig that is carried above the markers.

    Args:
        distortion: k1, k2, p1, p2[, k3] of `radtan`; none: a pinhole.
    """
    down_rad = _DOWN_SHARE * np.arctan2(layout.rig_height_m, layout.standoff_m)
    ahead = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    optical = Rotation.from_euler("y", down_rad) * ahead
    width, height = resolution_px
    camera = Camera(
        intrinsics_px=np.array([focal_px, focal_px, (width - 1) / 2 + 1.7, (height - 1) / 2 - 2.3]),
        distortion_model="radtan" if distortion else "none",
        distortion=np.array(distortion, dtype=np.float64),
        resolution_px=resolution_px,
        t_body_cam_m=np.array(T_BODY_CAM_M),
        quat_body_cam_wxyz=optical.as_quat(canonical=True, scalar_first=True),
    )
    tilt = Rotation.from_euler("xyz", LIDAR_TILT_RAD)
    return SensorRig(camera, RigidTransform.from_components(np.array(T_BODY_LIDAR_M), tilt))
