"""A textured room seen by an RGB-D camera: rays against the inside of a box, exact depths, any lens."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.data import Camera, RgbdFrame
from jaxgeo.geometry import rigid
from jaxgeo.mapping.rgbd_camera import RgbdCamera, rgbd_camera

HALF_M = np.array([2.0, 1.6, 1.3])  # the room: from -HALF_M to HALF_M
PIXELS_PER_M = 140


def pinhole(t_body_cam_m=(0.0, 0.0, 0.0), rotvec=(0.0, 0.0, 0.0), model="none", distortion=()) -> RgbdCamera:
    quat = Rotation.from_rotvec(rotvec).as_quat(scalar_first=True)
    return rgbd_camera(
        Camera(
            np.array([280.0, 282.0, 158.0, 121.0]),
            model,
            np.array(distortion),
            (320, 240),
            np.array(t_body_cam_m),
            quat,
        )
    )


def looking(position_m, yaw_rad, pitch_rad=0.0) -> np.ndarray:
    """`T_map_cam` of a camera that looks along yaw in the horizontal plane, z up in the map."""
    T = np.eye(4)
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # forward x, right -y, down -z
    T[:3, :3] = Rotation.from_euler("zy", [yaw_rad, pitch_rad]).as_matrix() @ level
    T[:3, 3] = position_m
    return T


def body_pose(T_map_cam: np.ndarray, camera: RgbdCamera) -> np.ndarray:
    return T_map_cam @ rigid.inverse(camera.T_body_cam)


def walls(seed: int) -> list[np.ndarray]:
    """Six textures with detail at several scales."""
    random = np.random.default_rng(seed)
    textures = []
    for wall in range(6):
        across = 2.0 * np.delete(HALF_M, wall // 2)
        size = tuple(int(side) for side in np.ceil(across * PIXELS_PER_M))
        texture = np.zeros((size[1], size[0], 3))
        for cells in (6, 25, 90):
            coarse = random.uniform(0.0, 1.0, (cells, cells, 3)).astype(np.float32)
            texture += cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
        textures.append(np.clip(texture * 85.0, 0, 255).astype(np.uint8))
    return textures


def photograph(textures, T_map_cam, camera: RgbdCamera, stamp_s=0.0, noise_m=0.0, seed=0) -> RgbdFrame:
    rays = np.concatenate([camera.rays, np.ones((*camera.rays.shape[:2], 1))], axis=-1)
    direction, at = rays @ T_map_cam[:3, :3].T, T_map_cam[:3, 3]
    direction = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
    to_wall = (np.sign(direction) * HALF_M - at) / direction
    axis = np.argmin(to_wall, axis=-1)
    depth = to_wall.min(axis=-1)
    points = at + direction * depth[..., None]
    image = np.zeros((*depth.shape, 3), dtype=np.uint8)
    for wall, texture in enumerate(textures):
        of = (axis == wall // 2) & (np.take_along_axis(direction, axis[..., None], -1)[..., 0] > 0) == bool(wall % 2)
        of &= axis == wall // 2
        u, v = (np.delete(points + HALF_M, wall // 2, axis=-1) * PIXELS_PER_M).astype(np.float32).transpose(2, 0, 1)
        image[of] = cv2.remap(texture, u.copy(), v.copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[of]
    depth = depth + noise_m * depth**2 * np.random.default_rng(seed).normal(size=depth.shape)
    depth[~camera.reached] = 0.0
    return RgbdFrame(stamp_s, image, depth.astype(np.float32), "room", int(stamp_s))


def off_walls_m(points_m: np.ndarray) -> np.ndarray:
    """Distance of points to the nearest wall's plane."""
    return np.min(np.abs(np.abs(points_m) - HALF_M), axis=1)
