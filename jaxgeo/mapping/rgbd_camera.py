"""The camera of RGB-D frames: what its depth pixels mean, worked out once."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import check_camera, undistort
from jaxgeo.data import Camera, RgbdFrame
from jaxgeo.errors import ScanError


@dataclasses.dataclass(frozen=True)
class RgbdCamera:
    """A camera at one resolution.

    Attributes:
        camera: its model.
        T_body_cam: (4, 4), optical axes to body.
        rays: (h, w, 2) x/z and y/z of every pixel's centre, 0 where the lens model does not reach.
        reached: (h, w) where it does.
    """

    camera: Camera
    T_body_cam: Float[np.ndarray, "4 4"]
    rays: Float[np.ndarray, "h w 2"]
    reached: Bool[np.ndarray, "h w"]

    @property
    def resolution_px(self) -> tuple[int, int]:
        return self.rays.shape[1], self.rays.shape[0]

    @property
    def focal_px(self) -> float:
        """Mean focal length: pixels of one unit of x/z."""
        return float(np.sqrt(self.camera.intrinsics_px[0] * self.camera.intrinsics_px[1]))

    def check(self, shape: tuple[int, ...], source: str) -> None:
        """Refuse an image of another size.

        Raises:
            ScanError: it is of another size.
        """
        if shape[:2] != self.rays.shape[:2]:
            width, height = self.resolution_px
            raise ScanError(
                f"{source}: image of {shape[1]} x {shape[0]} pixels, but the camera is calibrated for "
                f"{width} x {height}. Give the calibration of these images: intrinsics scale with the resolution."
            )

    def points_cam_m(self, depth_m: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
        """Points of a depth image in the camera's optical axes."""
        return np.concatenate([self.rays * depth_m[..., None], depth_m[..., None]], axis=-1)


def rgbd_camera(camera: Camera, resolution_px: tuple[int, int] | None = None) -> RgbdCamera:
    """Prepare a camera; `resolution_px` (width, height) where the calibration does not say it.

    Raises:
        ScanError: the resolution is not known, or not that of the calibration.
        SightingError: a distortion model or intrinsics that cannot be used.
    """
    check_camera("rgbd", camera)
    resolution = camera.resolution_px or resolution_px
    if resolution is None:
        raise ScanError("camera of the RGB-D frames: its resolution is not known; add `resolution` to the rig file.")
    if resolution_px is not None and tuple(resolution) != tuple(resolution_px):
        raise ScanError(
            f"camera of the RGB-D frames: calibrated for {resolution[0]} x {resolution[1]} pixels, but the frames have "
            f"{resolution_px[0]} x {resolution_px[1]}. Give the calibration of these images."
        )
    width, height = resolution
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays, reached = undistort(np.column_stack([columns.ravel(), rows.ravel()]), camera)
    T_body_cam = np.eye(4)
    T_body_cam[:3, :3] = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).as_matrix()
    T_body_cam[:3, 3] = camera.t_body_cam_m
    return RgbdCamera(camera, T_body_cam, rays.reshape(height, width, 2), reached.reshape(height, width))


def frames_camera(camera: Camera, frames: Iterable[RgbdFrame]) -> RgbdCamera:
    """Prepare a camera for the images of a source of frames, of which the first is read.

    Raises:
        ScanError: the source holds no frame, or the camera is calibrated for another resolution.
        SightingError: a distortion model or intrinsics that cannot be used.
    """
    first = next(iter(frames), None)
    if first is None:
        raise ScanError("RGB-D frames: the source holds none; expected at least one. Is the recording complete?")
    return rgbd_camera(camera, (first.image.shape[1], first.image.shape[0]))
