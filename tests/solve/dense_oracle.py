"""The graph as a dense least-squares problem: automatic derivatives of the residual function, then NumPy."""

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxgeo.graph.pose_graph import PoseGraph, residuals, zero_increments


@jax.jit
def _residual_and_jacobian(graph: PoseGraph) -> tuple[jax.Array, jax.Array]:
    zero, unravel = ravel_pytree(zero_increments(graph))

    def flat(y: jax.Array) -> jax.Array:
        return ravel_pytree(residuals(unravel(y), graph))[0]

    return flat(zero), jax.jacfwd(flat)(zero)


def dense_system(graph: PoseGraph, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residuals and their Jacobian; columns: 6 a real pose (world-frame increment), then globals."""
    residual, jacobian = (np.asarray(part) for part in _residual_and_jacobian(graph))
    padded = graph.chain.length_m.shape[0]
    used = [True] * 6 if graph.terms.bias else [False] * 6
    globals_used = 6 * padded + np.flatnonzero([*used, graph.terms.log_scale])
    poses = (np.arange(6)[None, :] * padded + np.arange(n)[:, None]).reshape(-1)
    return residual, jacobian[:, np.concatenate([poses, globals_used])]


def dense_factor(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upper R and sizes d with J'J = d R'R d: metres and radians differ by 1e6. In edge coordinates R is near 1."""
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / size
    return np.linalg.cholesky(scaled.T @ scaled).T, size


def dense_covariance(jacobian: np.ndarray, n: int) -> np.ndarray:
    """(J'J)^-1 of poses' increments and globals."""
    chain = edge_coordinates(n, jacobian.shape[1] - 6 * n)
    factor, size = dense_factor(jacobian @ chain)
    inverse = chain @ (np.linalg.inv(factor) / size[:, None])
    return inverse @ inverse.T


def edge_coordinates(n: int, g: int) -> np.ndarray:
    """The matrix from edges' increments to poses' increments, `delta_i = sum_(k<=i) w_k`; globals stay."""
    found = np.eye(6 * n + g)
    found[: 6 * n, : 6 * n] = np.kron(np.tril(np.ones((n, n))), np.eye(6))
    return found
