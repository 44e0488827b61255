"""What a large graph is asked before it is solved: is it finite, in one piece, its information no nonsense?"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxgeo.data.relative_poses import RelativePoses
from jaxgeo.errors import GraphError, UndeterminedError

# Rotations further from unit length than this are no rounding of a file's decimals.
_UNIT_SLACK = 1e-3
# Negative eigenvalues below this share of the largest one are rounding of a file's decimals.
_NEGATIVE_SLACK = 1e-6


def checked_graph(
    position_m: Float[np.ndarray, "n 3"], quat_wxyz: Float[np.ndarray, "n 4"], edges: RelativePoses
) -> tuple[Float[np.ndarray, "n 4"], RelativePoses]:
    """Start rotations and edges, quaternions brought to unit length, information made symmetric.

    Raises:
        GraphError: no poses or edges; numbers that are not finite; quaternions that are none; edges of unknown poses or
            of a pose with itself; information that is not symmetric; a graph in several pieces.
    """
    n, m = len(position_m), len(edges)
    if n < 2 or m < 1:
        raise GraphError(f"graph of {n} poses and {m} edges: expected at least two poses and one edge.")
    if quat_wxyz.shape != (n, 4):
        raise GraphError(f"{n} start positions but rotations of shape {quat_wxyz.shape}: expected ({n}, 4), wxyz.")
    bad = np.flatnonzero(~(np.isfinite(position_m).all(axis=1) & np.isfinite(quat_wxyz).all(axis=1)))
    if bad.size:
        raise GraphError(f"start pose {bad[0]}: {position_m[bad[0]]}, {quat_wxyz[bad[0]]}: expected finite numbers.")
    _check_ends(n, edges)
    flat = (edges.t_m, edges.quat_wxyz, edges.information.reshape(m, 36))
    bad = np.flatnonzero(~np.all([np.isfinite(part).all(axis=1) for part in flat], axis=0))
    if bad.size:
        raise GraphError(f"{_named(edges, bad[0])}: holds a number that is not finite.")
    information = 0.5 * (edges.information + edges.information.transpose(0, 2, 1))
    largest = np.abs(edges.information).max(axis=(1, 2))
    bad = np.flatnonzero(np.abs(information - edges.information).max(axis=(1, 2)) > _NEGATIVE_SLACK * largest)
    if bad.size:
        raise GraphError(f"{_named(edges, bad[0])}: its information matrix is not symmetric.")
    label = components(n, edges)
    if label.max() > 0:
        lost = int(np.flatnonzero(label != label[0])[0])
        raise GraphError(
            f"the graph is in {label.max() + 1} pieces: no edges lead from pose 0 to pose {lost} (its piece has "
            f"{int((label == label[lost]).sum())} poses). Add the edge between them, or solve the pieces one by one."
        )
    start = _unit(quat_wxyz, lambda i: f"start pose {i}")
    measured = _unit(edges.quat_wxyz, lambda i: _named(edges, i))
    return start, RelativePoses(edges.first, edges.second, edges.t_m, measured, information)


def components(n: int, edges: RelativePoses) -> Int[np.ndarray, "n"]:
    """The piece of the graph that every pose lies in, counted from 0."""
    matrix = coo_array((np.ones(len(edges)), (edges.first, edges.second)), shape=(n, n))
    return connected_components(matrix, directed=False)[1]


def check_pieces(n: int, edges: RelativePoses, weight: Float[np.ndarray, "m"]) -> None:
    """Refuse a graph that falls into pieces without its rejected edges (weight 0).

    Raises:
        UndeterminedError: naming a pose that nothing ties to the first one any more.
    """
    label = components(n, edges.take(np.flatnonzero(weight > 0)))
    if label.max() > 0:
        lost = int(np.flatnonzero(label != label[0])[0])
        raise UndeterminedError(
            f"every closure that ties pose {lost} (and {int((label == label[lost]).sum()) - 1} more) to the first pose "
            f"was rejected: {int((weight == 0).sum())} of {len(edges)} edges are. Is the information of the "
            "closures, or of the odometry, too confident?"
        )


def information_roots(edges: RelativePoses) -> tuple[Float[np.ndarray, "m 6 6"], Bool[np.ndarray, "m"]]:
    """Matrices R with `R'R` the information, and which edges have a definite one.

    Raises:
        GraphError: an information matrix has a negative eigenvalue, or is zero.
    """
    information = edges.information
    diagonal = np.diagonal(information, axis1=1, axis2=2)
    bad = np.flatnonzero((diagonal < 0).any(axis=1) | ~(diagonal > 0).any(axis=1))
    if bad.size:
        raise GraphError(
            f"{_named(edges, bad[0])}: its information matrix has the diagonal {diagonal[bad[0]].tolist()}; expected "
            "no negative numbers, and one that is positive."
        )
    try:
        return np.linalg.cholesky(information).transpose(0, 2, 1), np.ones(len(edges), bool)
    except np.linalg.LinAlgError:  # one at least is singular, or worse: eigenvalues tell which
        return _roots_by_eigenvalues(edges)


def _roots_by_eigenvalues(edges: RelativePoses) -> tuple[Float[np.ndarray, "m 6 6"], Bool[np.ndarray, "m"]]:
    information = edges.information
    values, vectors = np.linalg.eigh(information)
    bad = np.flatnonzero(values[:, 0] < -_NEGATIVE_SLACK * values[:, -1])
    if bad.size:
        raise GraphError(
            f"{_named(edges, bad[0])}: its information matrix has the eigenvalue {values[bad[0], 0]:.3g}; expected "
            "none below zero (are its 21 numbers the upper triangle, row by row?)."
        )
    roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.transpose(0, 2, 1)
    return roots, values[:, 0] > 1e-12 * values[:, -1]


def _check_ends(n: int, edges: RelativePoses) -> None:
    for end in (edges.first, edges.second):
        bad = np.flatnonzero((end < 0) | (end >= n))
        if bad.size:
            raise GraphError(f"{_named(edges, bad[0])}: expected poses between 0 and {n - 1}.")
    bad = np.flatnonzero(edges.first == edges.second)
    if bad.size:
        raise GraphError(f"{_named(edges, bad[0])}: ties a pose to itself.")


def _named(edges: RelativePoses, row: int) -> str:
    return f"edge {row} (pose {edges.first[row]} to pose {edges.second[row]})"


def _unit(quat: Float[np.ndarray, "n 4"], name: Callable[[int], str]) -> Float[np.ndarray, "n 4"]:
    norm = np.linalg.norm(quat, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1.0) > _UNIT_SLACK)
    if bad.size:
        raise GraphError(f"{name(bad[0])}: quaternion {quat[bad[0]]} has length {norm[bad[0]]:.4g}; expected 1.")
    return quat / norm[:, None]
