"""Both poses of square markers that explain four corners, refined, with covariance: many markers at once."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import undistort
from jaxgeo.associate.planar import UNIT_CORNERS, square_poses
from jaxgeo.associate.refinement import inverse_information, refine, reprojection_residual
from jaxgeo.data import Camera, CornerSightings, Rig

_IMAGE_ROOM = 0.05  # of the image size
# In standard deviations of the corners, where they are known: nothing is gained by smaller steps.
_STILL_WHITENED = 1e-3
_STILL_PX = 1e-7


@dataclasses.dataclass(frozen=True)
class SquarePairs:
    """The two planar solutions of each sighting, the better fitting one first. NaN where there is none.

    Attributes:
        R_body_marker, t_body_marker_m: (n, 2) poses.
        covariance: (n, 2, 6, 6), body axes (translation added, rotation multiplied on the left).
        fit: (n, 2) RMS of the eight residuals in their standard deviations: chi2 = 8 fit^2, two degrees of freedom.
        reprojection_px: (n, 2) RMS residuals.
        in_range: (n,) whether all corners are in the image and within the camera model's range.
    """

    R_body_marker: Float[np.ndarray, "n 2 3 3"]
    t_body_marker_m: Float[np.ndarray, "n 2 3"]
    covariance: Float[np.ndarray, "n 2 6 6"]
    fit: Float[np.ndarray, "n 2"]
    reprojection_px: Float[np.ndarray, "n 2"]
    in_range: Bool[np.ndarray, "n"]

    def take(self, rows: np.ndarray) -> "SquarePairs":
        """The chosen rows (indices or mask)."""
        return SquarePairs(**{field.name: getattr(self, field.name)[rows] for field in dataclasses.fields(self)})


def square_pairs(
    corners: CornerSightings,
    rig: Rig,
    size_m: Float[np.ndarray, "n"],
    pixel_sigma_px: float,
    whitening: Float[np.ndarray, "n 8 8"] | None,
) -> SquarePairs:
    """IPPE's two solutions of each sighting, each refined by r^T r / sigma^2, or by r^T C^-1 r where C is known."""
    n = len(corners)
    pairs = SquarePairs(
        R_body_marker=np.full((n, 2, 3, 3), np.nan),
        t_body_marker_m=np.full((n, 2, 3), np.nan),
        covariance=np.full((n, 2, 6, 6), np.nan),
        fit=np.full((n, 2), np.nan),
        reprojection_px=np.full((n, 2), np.nan),
        in_range=np.zeros(n, dtype=bool),
    )
    unit = pixel_sigma_px if whitening is None else 1.0  # what residuals are in, once refined
    for name in np.unique(corners.camera):
        rows = np.flatnonzero(corners.camera == name)
        camera, pixels = rig.cameras[str(name)], corners.corners_px[rows]
        normalised, reached = undistort(pixels.reshape(-1, 2), camera)
        usable = reached.reshape(-1, 4).all(axis=1) & _in_image(pixels, camera)
        pairs.in_range[rows] = usable
        rows, pixels, normalised = rows[usable], pixels[usable], normalised.reshape(-1, 4, 2)[usable]
        if rows.size == 0:
            continue
        white = None if whitening is None else whitening[rows]
        R, t, error, information, rms_px = _solve(normalised, pixels, size_m[rows], camera, white)
        R_body_cam = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).as_matrix()
        axes = np.kron(np.eye(2), R_body_cam)
        pairs.R_body_marker[rows] = R_body_cam @ R
        pairs.t_body_marker_m[rows] = t @ R_body_cam.T + camera.t_body_cam_m
        pairs.covariance[rows] = unit**2 * axes @ inverse_information(information) @ axes.T
        pairs.fit[rows], pairs.reprojection_px[rows] = np.sqrt(error / 8.0) / unit, rms_px
    return pairs


def _solve(
    normalised: Float[np.ndarray, "n 4 2"],
    pixels: Float[np.ndarray, "n 4 2"],
    size_m: Float[np.ndarray, "n"],
    camera: Camera,
    whitening: Float[np.ndarray, "n 8 8"] | None,
) -> tuple[
    Float[np.ndarray, "n 2 3 3"],
    Float[np.ndarray, "n 2 3"],
    Float[np.ndarray, "n 2"],
    Float[np.ndarray, "n 2 6 6"],
    Float[np.ndarray, "n 2"],
]:
    """Rotations and centres in the camera (best first), squared residuals, J^T J, and RMS residuals in pixels.

    A solution behind the camera has a squared residual of NaN and goes last.
    """
    n = len(normalised)
    rotations, translations = square_poses(normalised, size_m)
    corners_m = np.repeat(size_m, 2)[:, None, None] * np.column_stack([UNIT_CORNERS, np.zeros(4)])
    twice = None if whitening is None else np.repeat(whitening, 2, axis=0)
    R, t, error, information = refine(
        rotations.reshape(-1, 3, 3),
        translations.reshape(-1, 3),
        corners_m,
        np.repeat(pixels, 2, axis=0),
        camera,
        twice,
        _STILL_PX if whitening is None else _STILL_WHITENED,
    )
    order = (2 * np.arange(n)[:, None] + np.argsort(error.reshape(n, 2), axis=1)).ravel()  # NaN goes last
    R, t, error, information = R[order], t[order], error[order], information[order]
    rms_px = np.sqrt(error / 8.0)
    if whitening is not None:
        residual_px = reprojection_residual(R, t, corners_m, np.repeat(pixels, 2, axis=0), camera)
        rms_px = np.where(np.isnan(error), np.nan, np.sqrt(np.mean(residual_px**2, axis=1)))
    return (
        R.reshape(n, 2, 3, 3),
        t.reshape(n, 2, 3),
        error.reshape(n, 2),
        information.reshape(n, 2, 6, 6),
        rms_px.reshape(n, 2),
    )


def _in_image(corners_px: Float[np.ndarray, "n 4 2"], camera: Camera) -> Bool[np.ndarray, "n"]:
    """All four corners in the image, with a little room for extrapolated ones; True where its size is not known."""
    if camera.resolution_px is None:
        return np.ones(len(corners_px), dtype=bool)
    size_px = np.array(camera.resolution_px)
    room_px = _IMAGE_ROOM * size_px
    return np.all((corners_px >= -room_px) & (corners_px <= size_px + room_px), axis=(1, 2))
