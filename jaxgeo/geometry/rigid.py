"""Rigid motions as 4x4 NumPy matrices, the front end's form of a pose; tangents are (translation, rotation).

The estimators work on quaternions through JAX (`jaxgeo.geometry`); a front end that handles one pose at a time would
wait for its dispatch. The two agree (`tests/geometry/test_rigid.py`).
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory

_SERIES_BELOW = 1e-4  # rad^2


def matrices(
    position_m: Float[np.ndarray, "*b 3"], quat_wxyz: Float[np.ndarray, "*b 4"]
) -> Float[np.ndarray, "*b 4 4"]:
    """Poses from positions and unit quaternions."""
    T = np.zeros((*position_m.shape[:-1], 4, 4))
    T[..., :3, :3] = Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()
    T[..., :3, 3] = position_m
    T[..., 3, 3] = 1.0
    return T


def trajectory_matrices(trajectory: Trajectory) -> Float[np.ndarray, "n 4 4"]:
    """`T_map_body` of every pose."""
    return matrices(trajectory.position_m, trajectory.quat_wxyz)


def parts(T: Float[np.ndarray, "*b 4 4"]) -> tuple[Float[np.ndarray, "*b 3"], Float[np.ndarray, "*b 4"]]:
    """Positions and quaternions (wxyz) of poses."""
    return T[..., :3, 3].copy(), Rotation.from_matrix(T[..., :3, :3]).as_quat(scalar_first=True)


def inverse(T: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 4 4"]:
    """`T_b_a` of `T_a_b`."""
    back = np.zeros_like(T)
    back[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
    back[..., :3, 3] = -(back[..., :3, :3] @ T[..., :3, 3, None])[..., 0]
    back[..., 3, 3] = 1.0
    return back


def apply(T: Float[np.ndarray, "4 4"], points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """`R x + t` of every point."""
    return points_m @ T[:3, :3].T + T[:3, 3]


def log(T: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 6"]:
    """Tangents of poses: `V^-1 t` and the rotation vector (Barfoot 2017, eq. 7.38)."""
    rotvec = Rotation.from_matrix(T[..., :3, :3]).as_rotvec()
    t2 = np.sum(rotvec * rotvec, axis=-1)
    small = t2 < _SERIES_BELOW
    half = 0.5 * np.sqrt(np.where(small, 1.0, t2))
    c = np.where(small, 1.0 / 12.0 + t2 / 720.0, (1.0 - half * np.cos(half) / np.sin(half)) / (4.0 * half**2))
    t = T[..., :3, 3]
    turned = np.cross(rotvec, t)
    return np.concatenate([t - 0.5 * turned + c[..., None] * np.cross(rotvec, turned), rotvec], axis=-1)


def exp(tangent: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 4 4"]:
    """Poses of tangents: `V v` and the rotation (Barfoot 2017, eq. 7.37)."""
    v, w = tangent[..., :3], tangent[..., 3:]
    t2 = np.sum(w * w, axis=-1)
    small = t2 < _SERIES_BELOW
    theta = np.sqrt(np.where(small, 1.0, t2))
    b = np.where(small, 0.5 - t2 / 24.0, 2.0 * (np.sin(0.5 * theta) / theta) ** 2)
    c = np.where(small, 1.0 / 6.0 - t2 / 120.0, (theta - np.sin(theta)) / theta**3)
    turned = np.cross(w, v)
    T = np.zeros((*tangent.shape[:-1], 4, 4))
    T[..., :3, :3] = Rotation.from_rotvec(w).as_matrix()
    T[..., :3, 3] = v + b[..., None] * turned + c[..., None] * np.cross(w, turned)
    T[..., 3, 3] = 1.0
    return T


def adjoint(T: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 6 6"]:
    """Ad of `T Exp(x) T^-1 = Exp(Ad x)`: [[R, hat(t) R], [0, R]]."""
    R, t = T[..., :3, :3], T[..., :3, 3]
    Ad = np.zeros((*T.shape[:-2], 6, 6))
    Ad[..., :3, :3] = Ad[..., 3:, 3:] = R
    Ad[..., :3, 3:] = np.cross(t[..., None, :], np.swapaxes(R, -1, -2)).swapaxes(-1, -2)
    return Ad


def turn_rad(T: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b"]:
    """Angle of every rotation, 0 .. pi."""
    return Rotation.from_matrix(T[..., :3, :3]).magnitude()
