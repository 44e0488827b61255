"""Poses of square markers refined on the raw pixels: weighted Levenberg-Marquardt over many markers at once."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import project
from jaxgeo.data import Camera

_MAX_STEPS = 30


def refine(
    R: Float[np.ndarray, "n 3 3"],
    t: Float[np.ndarray, "n 3"],
    corners_m: Float[np.ndarray, "n 4 3"],
    pixels: Float[np.ndarray, "n 4 2"],
    camera: Camera,
    whitening: Float[np.ndarray, "n 8 8"] | None = None,
    still: float = 1e-7,
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n"], Float[np.ndarray, "n 6 6"]]:
    """Levenberg-Marquardt on the distorted pixels, every marker with its own damping.

    Args:
        R, t: starts in the camera's optical axes; rows that are not finite, or not in front of it, are not refined.
        corners_m: the corners in the marker's frame.
        pixels: where they were seen.
        whitening: V with V C V^T = I of the corners' covariance C: residuals are V r, free of units. None: r in pixels.
        still: a marker is done when a step moves no corner further than this (pixels, or standard deviations).

    Returns:
        rotations, translations, squared residuals and J^T J at the end (tangent: translation added, rotation on the
        left, camera axes). A start that is not in front of the camera comes back with a squared residual of NaN.
    """
    residual, jacobian, ok = _linearise(R, t, corners_m, pixels, camera, whitening)
    error = np.where(ok, np.sum(residual**2, axis=1), np.nan)
    information = np.swapaxes(jacobian, 1, 2) @ jacobian
    damping = np.full(len(R), 1e-3)
    active = np.flatnonzero(ok)
    R, t = R.copy(), t.copy()
    for _ in range(_MAX_STEPS):
        if active.size == 0:
            break
        # Few markers, and all still moving: no copies. Their cost is that of NumPy's calls, not of the sums.
        part = slice(None) if active.size == len(R) else active
        step = _damped_step(information[part], jacobian[part], residual[part], damping[part])
        R_new = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ R[part]
        t_new = t[part] + step[:, :3]
        chosen = None if whitening is None else whitening[part]
        new_residual, new_jacobian, new_ok = _linearise(R_new, t_new, corners_m[part], pixels[part], camera, chosen)
        new_error = np.sum(new_residual**2, axis=1)
        better = new_ok & (new_error <= error[part])
        won = active[better]
        R[won], t[won], error[won] = R_new[better], t_new[better], new_error[better]
        residual[won], jacobian[won] = new_residual[better], new_jacobian[better]
        information[won] = np.swapaxes(new_jacobian[better], 1, 2) @ new_jacobian[better]
        damping[part] = np.where(better, damping[part] / 10.0, damping[part] * 10.0)
        # A step that moves no corner ends it; so does a damping that no longer lets anything move.
        predicted = np.linalg.norm(np.einsum("nij,nj->ni", new_jacobian, step), axis=1)
        active = active[(predicted > still) & (damping[part] < 1e8)]
    return R, t, error, information


def reprojection_residual(
    R: Float[np.ndarray, "n 3 3"],
    t: Float[np.ndarray, "n 3"],
    corners_m: Float[np.ndarray, "n 4 3"],
    pixels: Float[np.ndarray, "n 4 2"],
    camera: Camera,
) -> Float[np.ndarray, "n 8"]:
    """Predicted less seen corners of poses in the camera, pixels: u0, v0, u1, v1, .."""
    return _linearise(R, t, corners_m, pixels, camera, None)[0]


def inverse_information(information: Float[np.ndarray, "*n 6 6"]) -> Float[np.ndarray, "*n 6 6"]:
    """Inverses scaled to unit diagonal first (metres and radians differ in size); NaN where one does not exist."""
    shape, information = information.shape, information.reshape(-1, 6, 6)
    scale = np.sqrt(np.einsum("nii->ni", information))
    usable = np.all(np.isfinite(information), axis=(1, 2)) & np.all(scale > 0.0, axis=1)
    if not usable.all():
        scale = np.where(usable[:, None], scale, 1.0)
        information = np.where(usable[:, None, None], information, np.eye(6))
    unit = information / scale[:, :, None] / scale[:, None, :]
    size = np.linalg.svd(unit, compute_uv=False)
    usable &= size[:, 0] < 1e12 * size[:, -1]
    if usable.all():
        return (np.linalg.inv(unit) / scale[:, :, None] / scale[:, None, :]).reshape(shape)
    inverse = np.linalg.inv(np.where(usable[:, None, None], unit, np.eye(6))) / scale[:, :, None] / scale[:, None, :]
    return np.where(usable[:, None, None], inverse, np.nan).reshape(shape)


def _damped_step(
    information: Float[np.ndarray, "n 6 6"],
    jacobian: Float[np.ndarray, "n 8 6"],
    residual: Float[np.ndarray, "n 8"],
    damping: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "n 6"]:
    """Marquardt's step: the diagonal of J^T J is raised by its own damped size, so that units do not matter."""
    diagonal = np.einsum("nii->ni", information)
    floor = 1e-12 * diagonal.max(axis=1, keepdims=True)
    damped = information.copy()
    np.einsum("nii->ni", damped)[:] += damping[:, None] * (diagonal + floor)
    gradient = np.einsum("nij,ni->nj", jacobian, residual)
    return -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]


def _linearise(
    R: Float[np.ndarray, "n 3 3"],
    t: Float[np.ndarray, "n 3"],
    corners_m: Float[np.ndarray, "n 4 3"],
    pixels: Float[np.ndarray, "n 4 2"],
    camera: Camera,
    whitening: Float[np.ndarray, "n 8 8"] | None,
) -> tuple[Float[np.ndarray, "n 8"], Float[np.ndarray, "n 8 6"], Bool[np.ndarray, "n"]]:
    """Reprojection residuals, their derivative, and whether all four corners are in front of the camera."""
    turned = corners_m @ np.swapaxes(R, 1, 2)
    points = turned + t[:, None]
    finite = np.all(np.isfinite(points), axis=(1, 2))
    if not finite.all():
        points = np.where(finite[:, None, None], points, [0.0, 0.0, -1.0])
        turned = np.where(finite[:, None, None], turned, 0.0)
    predicted, by_point, in_front = project(points.reshape(-1, 3), camera)
    jacobian = np.empty((len(R), 4, 2, 6))
    jacobian[..., :3] = by_point.reshape(-1, 4, 2, 3)
    # d(Exp(w) R X)/dw = -[R X]_x, and a row r times -[a]_x is the cross product a x r; np.cross is slow for few rows.
    x, y, z = (turned[:, :, None, k] for k in range(3))
    rx, ry, rz = (jacobian[..., k] for k in range(3))
    jacobian[..., 3] = y * rz - z * ry
    jacobian[..., 4] = z * rx - x * rz
    jacobian[..., 5] = x * ry - y * rx
    jacobian = jacobian.reshape(-1, 8, 6)
    if not finite.all():
        jacobian[~finite] = 0.0
    residual = (predicted.reshape(-1, 4, 2) - pixels).reshape(-1, 8)
    if whitening is not None:
        residual, jacobian = (whitening @ residual[:, :, None])[:, :, 0], whitening @ jacobian
    return residual, jacobian, finite & in_front.reshape(-1, 4).all(axis=1)
