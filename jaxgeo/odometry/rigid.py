"""Rigid motions as 4x4 NumPy matrices; tangents are (translation, rotation), metres and radians."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

_SWAPPED = [3, 4, 5, 0, 1, 2]  # SciPy puts the rotation first


def exp_se3(tangent: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
    """The motion of a tangent."""
    return RigidTransform.from_exp_coords(tangent[_SWAPPED]).as_matrix()


def log_se3(T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6"]:
    """The tangent of a motion; its rotation is at most pi long."""
    return RigidTransform.from_matrix(T).as_exp_coords()[_SWAPPED]


def inverse(T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The inverse motion, its rotation transposed exactly."""
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def moved(T_a_b: Float[np.ndarray, "4 4"], points_b_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Points of frame b in frame a."""
    return points_b_m @ T_a_b[:3, :3].T + T_a_b[:3, 3]
