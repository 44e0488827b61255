"""A start for large graphs that needs no good guess: rotations by chordal relaxation, then positions.

Rotations as free 3x3 matrices make the edges linear; the nearest rotations to the solution are a good start even where
the given one winds the wrong way round (Carlone, Tron, Daniilidis and Dellaert, Initialization techniques for 3D
SLAM, ICRA 2015, section III). With the rotations held, positions are linear as well.
"""

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from jaxgeo.data.relative_poses import RelativePoses


def chordal_start(
    position_m: Float[np.ndarray, "n 3"], quat_wxyz: Float[np.ndarray, "n 4"], edges: RelativePoses
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Positions and rotations (wxyz) from the edges alone; of the given poses only the first, which stays.

    False closures spoil it, and reweighting them (Huber's loss in both problems) did not mend that.

    Args:
        position_m, quat_wxyz: the given poses.
        edges: of a graph in one piece.
    """
    first, second = edges.first, edges.second
    # One number for an edge's rotations, one for its positions: the mean of its information.
    diagonal = np.diagonal(edges.information, axis1=1, axis2=2)
    on_position, on_rotation = _positive(diagonal[:, :3].mean(axis=1)), _positive(diagonal[:, 3:].mean(axis=1))
    relative = Rotation.from_quat(edges.quat_wxyz, scalar_first=True).as_matrix()
    held = Rotation.from_quat(quat_wxyz[0], scalar_first=True).as_matrix()
    n = len(position_m)
    rotation = _rotations(n, first, second, relative, on_rotation, held)
    position = _positions(n, first, second, np.einsum("mij,mj->mi", rotation[first], edges.t_m), on_position)
    return position + position_m[0], Rotation.from_matrix(rotation).as_quat(scalar_first=True)


def _positions(
    n: int, first: np.ndarray, second: np.ndarray, step: Float[np.ndarray, "m 3"], weight: Float[np.ndarray, "m"]
) -> Float[np.ndarray, "n 3"]:
    """`min sum_e w_e |p_second - p_first - step_e|^2`, the first at zero."""
    force = np.zeros((n, 3))
    np.add.at(force, second, weight[:, None] * step)
    np.add.at(force, first, -weight[:, None] * step)
    position = np.zeros((n, 3))
    position[1:] = _solved(_connection(n, first, second, weight[:, None, None], weight), 1, force[1:])
    return position


def _rotations(
    n: int,
    first: np.ndarray,
    second: np.ndarray,
    relative: Float[np.ndarray, "m 3 3"],
    weight: Float[np.ndarray, "m"],
    held: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "n 3 3"]:
    """`min sum_e w_e |R_second - R_first Z_e|^2` over free matrices, the first held; then the nearest rotations."""
    matrix = _connection(n, first, second, weight[:, None, None] * relative, weight)
    # Unknown: R' of every pose, three rows each.
    free = _solved(matrix, 3, -(matrix[3:, :3] @ held.T)).reshape(n - 1, 3, 3).transpose(0, 2, 1)
    u, _, vt = np.linalg.svd(free)
    proper = np.ones((n - 1, 3))
    proper[:, 2] = np.linalg.det(u @ vt)
    return np.concatenate([held[None], (u * proper[:, None, :]) @ vt])


def _connection(
    n: int, first: np.ndarray, second: np.ndarray, turn: Float[np.ndarray, "m d d"], weight: Float[np.ndarray, "m"]
) -> csc_array:
    """Normal matrix of `x_second - turn_e' x_first / w_e`, each of weight w_e and turns orthogonal."""
    d = turn.shape[1]
    degree = np.bincount(first, weight, n) + np.bincount(second, weight, n)
    blocks = np.concatenate([-turn, -turn.transpose(0, 2, 1), degree[:, None, None] * np.eye(d)])
    row = np.concatenate([first, second, np.arange(n)])[:, None, None] * d + np.arange(d)[None, :, None]
    column = np.concatenate([second, first, np.arange(n)])[:, None, None] * d + np.arange(d)[None, None, :]
    row, column = np.broadcast_arrays(row, column)
    return coo_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(n * d, n * d)).tocsc()


def _solved(matrix: csc_array, held: int, rhs: np.ndarray) -> np.ndarray:
    """With the first `held` unknowns taken out. Symmetric mode: half the time of the default."""
    factor = splu(
        matrix[held:, held:].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return factor.solve(rhs)


def _positive(weight: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    """Edges without any information of a kind get a trace, so that the system stays definite."""
    return np.maximum(weight, 1e-9 * weight.max())
