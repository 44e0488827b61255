"""Poses as matrices, from formats without lines: the checks that every such reader owes."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.errors import InputError

ROTATION_TOLERANCE = 5e-3  # of R R^T - 1, as in KITTI rows of three decimals; float32 gives up to 1e-6


def check_poses(poses: Float[np.ndarray, "n r 4"], place: Callable[[int], str], error: type[InputError]) -> None:
    """Refuse poses `[R | t]` that are not finite, or whose R is no rotation.

    Args:
        poses: (n, 3, 4) or (n, 4, 4).
        place: names the pose of a row, for messages.
        error: the kind of error to raise.

    Raises:
        error: with the place of the first such pose.
    """
    wrong = ~np.isfinite(poses).all(axis=(1, 2))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise error(f"{place(row)}: the pose holds {_odd(poses[row])}; expected finite numbers. Is the file damaged?")
    rotation = poses[:, :3, :3]
    off, mirrored = rotation_faults(rotation)
    wrong = (off > ROTATION_TOLERANCE) | mirrored
    if wrong.any():
        row = int(np.argmax(wrong))
        problem = (
            f"R R^T is off the identity by {off[row]:.3g}, expected at most {ROTATION_TOLERANCE:g}"
            if off[row] > ROTATION_TOLERANCE
            else "R is a reflection (determinant -1), expected a rotation"
        )
        raise error(f"{place(row)}: {problem}. Is the pose the rows of [R | t], without a scale?")


def rotation_faults(matrix: Float[np.ndarray, "n 3 3"]) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """How far R R^T is off the identity (infinite where beyond float64), and whether R is a reflection."""
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(matrix @ matrix.mT - np.eye(3)).max(axis=(1, 2), initial=0.0)
    off = np.where(np.isnan(off), np.inf, off)
    near = np.where((off < 1.0)[:, None, None], matrix, np.eye(3))
    return off, np.linalg.det(near) < 0


def pose_parts(poses: Float[np.ndarray, "n r 4"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Positions, and the quaternions wxyz of the nearest rotations."""
    quat_wxyz = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True).reshape(-1, 4)
    return np.ascontiguousarray(poses[:, :3, 3]), quat_wxyz


def _odd(pose: Float[np.ndarray, "r 4"]) -> float:
    return float(pose[~np.isfinite(pose)][0])
