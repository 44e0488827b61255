"""A lens as the corner fit needs it: to a flat image, in which straight edges are straight, and back."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from jaxgeo.associate.camera_model import project, undistort
from jaxgeo.data import Camera


def flattened(
    pixels: Float[np.ndarray, "n 2"], camera: Camera | None
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Pixels of the flat image with the same focal lengths and centre, and whether the lens model reaches them."""
    if camera is None:
        return pixels, np.ones(len(pixels), dtype=bool)
    fx, fy, cx, cy = camera.intrinsics_px
    normalised, ok = undistort(pixels, camera)
    return normalised * np.array([fx, fy]) + np.array([cx, cy]), ok


def bent(
    flat: Float[np.ndarray, "n 2"], camera: Camera | None
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"]]:
    """Pixels of the image as taken, and their derivative by the flat ones."""
    if camera is None:
        return flat, np.broadcast_to(np.eye(2), (len(flat), 2, 2))
    fx, fy, cx, cy = camera.intrinsics_px
    rays = np.column_stack([(flat - np.array([cx, cy])) / np.array([fx, fy]), np.ones(len(flat))])
    pixels, by_point, _ = project(rays, camera)
    return pixels, by_point[:, :, :2] / np.array([fx, fy])


def of_crop(camera: Camera | None, x0: int, y0: int, enlarged: int = 1) -> Camera | None:
    """The camera of a part of the image that starts at (x0, y0), enlarged by a whole number."""
    if camera is None or camera.distortion_model == "none":
        return None
    fx, fy, cx, cy = camera.intrinsics_px
    centre = (np.array([cx - x0, cy - y0]) + 0.5) * enlarged - 0.5
    intrinsics = np.array([fx * enlarged, fy * enlarged, *centre])
    return dataclasses.replace(camera, intrinsics_px=intrinsics, resolution_px=None)
