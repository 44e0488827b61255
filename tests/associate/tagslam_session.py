"""TagSLAM's test 11, read with NumPy alone."""

from typing import NamedTuple

import numpy as np
from data_root import data_root
from scipy.spatial.transform import Rotation

from jaxgeo.data import Camera, CornerSightings, Rig, Survey, Trajectory

INTRINSICS_PX = ([603.924, 603.166, 665.041, 554.34], [604.531, 604.051, 648.481, 440.254])
DISTORTION = ([-0.0122741, -0.0100319, 0.00752173, -0.00247881], [-0.0125359, -0.00914094, 0.00627174, -0.002174])
T_RIG_CAM = (([0.0] * 3, [0.0] * 3), ([0.20031766, 0.00166686, 0.00093769], [0.00040784, -0.00929578, 0.00284823]))
T_RIG_ODOM = ([0.02535438, 0.02040908, -0.02218717], [-1.50468965e-2, -1.17231429e-3, -3.13883257])


class Session(NamedTuple):
    corners: CornerSightings  # of surveyed tags
    rig: Rig
    vio: Trajectory
    reference: Trajectory  # of the same body as the rig's
    tags: dict[str, np.ndarray]  # size, x, y, z, rotation vector as surveyed
    adjusted_tags: dict[str, np.ndarray]  # x, y, z, rotation vector after TagSLAM's own adjustment
    survey: Survey


def load(body: str) -> Session:
    """`body`: "rig" (the reference's own body) or "odom" (the VIO's: camera and reference poses are moved there)."""
    folder = data_root() / "tagslam" / "test_11"
    rows = np.loadtxt(folder / "tag_detections.csv", delimiter=",")
    tags = {str(int(row[0])): row[1:] for row in np.loadtxt(folder / "surveyed_tags.csv", delimiter=",")}
    adjusted = {str(int(row[0])): row[1:] for row in np.loadtxt(folder / "tagslam_optimized_tags.csv", delimiter=",")}
    rows = rows[[str(int(marker)) in tags for marker in rows[:, 2]]]
    t_rig_body, rotvec = T_RIG_ODOM if body == "odom" else (np.zeros(3), np.zeros(3))
    R_rig_body = Rotation.from_rotvec(rotvec)
    reference = _trajectory(folder / "tagslam_reference_odom.tum")
    R_world_rig = Rotation.from_quat(reference.quat_wxyz, scalar_first=True)
    return Session(
        corners=CornerSightings(
            stamp_s=rows[:, 0],
            camera=np.array([f"cam{int(camera)}" for camera in rows[:, 1]]),
            marker=np.array([str(int(marker)) for marker in rows[:, 2]]),
            corners_px=rows[:, 4:].reshape(-1, 4, 2),
            source=np.array([f"tag_detections.csv:{i + 2}" for i in range(len(rows))]),
        ),
        rig=Rig(cameras={f"cam{i}": _camera(i, R_rig_body, np.asarray(t_rig_body)) for i in (0, 1)}),
        vio=_trajectory(folder / "vio_odom.tum"),
        reference=Trajectory(
            stamp_s=reference.stamp_s,
            position_m=reference.position_m + R_world_rig.apply(t_rig_body),
            quat_wxyz=(R_world_rig * R_rig_body).as_quat(scalar_first=True),
        ),
        tags=tags,
        adjusted_tags=adjusted,
        survey=Survey(
            name=tuple(tags),
            enh_m=np.array([tag[1:4] for tag in tags.values()]),
            sigma_m=np.full((len(tags), 3), 0.05),
            quat_grid_marker_wxyz=Rotation.from_rotvec([tag[4:7] for tag in tags.values()]).as_quat(scalar_first=True),
            sigma_rot_rad=np.full((len(tags), 3), 0.05),
            crs="local",
        ),
    )


def _camera(i: int, R_rig_body: Rotation, t_rig_body: np.ndarray) -> Camera:
    t_rig_cam, rotvec = T_RIG_CAM[i]
    return Camera(
        intrinsics_px=np.array(INTRINSICS_PX[i]),
        distortion_model="equidistant",
        distortion=np.array(DISTORTION[i]),
        resolution_px=(1280, 1024),
        t_body_cam_m=R_rig_body.inv().apply(t_rig_cam - t_rig_body),
        quat_body_cam_wxyz=(R_rig_body.inv() * Rotation.from_rotvec(rotvec)).as_quat(scalar_first=True),
    )


def _trajectory(path) -> Trajectory:
    rows = np.loadtxt(path)
    quat = rows[:, [7, 4, 5, 6]]
    return Trajectory(rows[:, 0], rows[:, 1:4], quat / np.linalg.norm(quat, axis=1, keepdims=True))
