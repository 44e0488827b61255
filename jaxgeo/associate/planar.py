"""Both poses of a square marker from its four undistorted corners (IPPE), for many markers at once.

A planar square seen by a camera has two candidate rotations, mirror images about the line of sight to first order.
OpenCV's IPPE_SQUARE solves one marker a call and fixes its own corner order; this is the same method over arrays.
"""

import numpy as np
from jaxtyping import Float

# Corner order of `CornerSightings`, in units of the side length.
UNIT_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def square_poses(
    normalised: Float[np.ndarray, "n 4 2"], side_m: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 2 3 3"], Float[np.ndarray, "n 2 3"]]:
    """The two rotations R_cam_marker and centres t_cam_marker (metres) of each square.

    Collins & Bartoli, "Infinitesimal plane-based pose estimation", IJCV 2014: the homography's first derivative at the
    marker's centre fixes the rotation up to one sign. Rows whose corners are degenerate (three on a line) come back
    as NaN.
    """
    homography = _homographies(normalised)
    centre = homography[:, :2, 2]
    jacobian = homography[:, :2, :2] - centre[:, :, None] * homography[:, 2:, :2]  # d (x/z, y/z) / d (marker x, y)
    rotation_view = _rotation_to(np.column_stack([centre, np.ones(len(centre))]))
    projection = np.concatenate([np.broadcast_to(np.eye(2), (len(centre), 2, 2)), -centre[:, :, None]], axis=2)
    affine = _solve(projection @ rotation_view[:, :, :2], jacobian)
    largest = np.linalg.norm(np.nan_to_num(affine), ord=2, axis=(1, 2))
    upper = affine / np.where(largest > 0.0, largest, np.nan)[:, None, None]
    gap = np.eye(2) - np.swapaxes(upper, 1, 2) @ upper
    third = np.sqrt(np.clip(np.stack([gap[:, 0, 0], gap[:, 1, 1]], axis=1), 0.0, None))
    third[:, 1] *= np.where(gap[:, 0, 1] < 0.0, -1.0, 1.0)
    both = _complete(np.repeat(upper, 2, axis=0), np.stack([third, -third], axis=1).reshape(-1, 2))
    rotations = np.repeat(rotation_view, 2, axis=0) @ both
    translations = _translations(np.repeat(normalised, 2, axis=0), rotations, np.repeat(side_m, 2))
    return rotations.reshape(-1, 2, 3, 3), translations.reshape(-1, 2, 3)


def _homographies(normalised: Float[np.ndarray, "n 4 2"]) -> Float[np.ndarray, "n 3 3"]:
    """Homography from unit-square coordinates to normalised image coordinates, lower right entry 1."""
    n = len(normalised)
    x, y = UNIT_CORNERS.T
    u, v = normalised[:, :, 0], normalised[:, :, 1]
    rows = np.zeros((n, 8, 8))
    rows[:, 0::2, 0], rows[:, 0::2, 1], rows[:, 0::2, 2] = x, y, 1.0
    rows[:, 1::2, 3], rows[:, 1::2, 4], rows[:, 1::2, 5] = x, y, 1.0
    rows[:, 0::2, 6], rows[:, 0::2, 7] = -u * x, -u * y
    rows[:, 1::2, 6], rows[:, 1::2, 7] = -v * x, -v * y
    entries = _solve(rows, normalised.reshape(n, 8, 1))[:, :, 0]
    return np.concatenate([entries, np.ones((n, 1))], axis=1).reshape(n, 3, 3)


def _solve(matrix: Float[np.ndarray, "n a a"], right: Float[np.ndarray, "n a b"]) -> Float[np.ndarray, "n a b"]:
    """Batched solve; rows with a (nearly) singular matrix become NaN instead of stopping the batch."""
    finite = np.all(np.isfinite(matrix), axis=(1, 2)) & np.all(np.isfinite(right), axis=(1, 2))
    matrix = matrix if finite.all() else np.where(finite[:, None, None], matrix, np.eye(matrix.shape[1]))
    size = np.linalg.svd(matrix, compute_uv=False)
    usable = finite & (size[:, 0] < 1e12 * size[:, -1])
    if usable.all():
        return np.linalg.solve(matrix, right)
    matrix = np.where(usable[:, None, None], matrix, np.eye(matrix.shape[1]))
    solution = np.linalg.solve(matrix, np.where(usable[:, None, None], right, 0.0))
    return np.where(usable[:, None, None], solution, np.nan)


def _rotation_to(direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The smallest rotation that takes the optical axis (0, 0, 1) to each direction (z > 0)."""
    x, y, z = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).T
    factor = 1.0 / (1.0 + z)
    return np.stack(
        [1.0 - factor * x * x, -factor * x * y, x, -factor * x * y, 1.0 - factor * y * y, y, -x, -y, z], axis=1
    ).reshape(-1, 3, 3)


def _complete(upper: Float[np.ndarray, "n 2 2"], third: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3 3"]:
    """A rotation from the upper 2x2 block and third row of its first two columns."""
    whole = np.empty((len(upper), 3, 3))
    whole[:, :2, :2], whole[:, 2, :2] = upper, third
    ax, ay, az, bx, by, bz = (whole[:, k, column] for column in (0, 1) for k in range(3))
    whole[:, 0, 2], whole[:, 1, 2], whole[:, 2, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return whole


def _translations(
    normalised: Float[np.ndarray, "n 4 2"], rotation: Float[np.ndarray, "n 3 3"], side_m: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 3"]:
    """Least-squares centre given the rotation: u (z + Z) = x + X for every corner, linear in (x, y, z)."""
    corners = (side_m[:, None, None] * UNIT_CORNERS) @ np.swapaxes(rotation[:, :, :2], 1, 2)
    left = np.zeros((len(normalised), 8, 3))
    left[:, 0::2, 0] = 1.0
    left[:, 1::2, 1] = 1.0
    left[:, :, 2] = -normalised.reshape(-1, 8)
    right = normalised * corners[:, :, 2:] - corners[:, :, :2]
    transposed = np.swapaxes(left, 1, 2)
    return _solve(transposed @ left, transposed @ right.reshape(-1, 8, 1))[:, :, 0]
