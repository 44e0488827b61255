"""Posterior covariance of poses, from the anchors' small system.

Universal kriging: with C_i the prior covariance of pose i with the anchors' rows, M theirs, X_i = I - C_i M^-1 H_0,

    P_i = S_i + D_i P D_i' - C_i M^-1 C_i' + X_i (H_0' M^-1 H_0)^-1 X_i'
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgeo.graph.chain import Poses
from jaxgeo.graph.pose_graph import Globals, PoseGraph
from jaxgeo.solve.adjoint import linearisation, rebased
from jaxgeo.solve.linearise import (
    SmallSystem,
    covariance_blocks,
    covariance_rows,
    globals_blocks,
    globals_rows,
    hat,
    solve_gauge,
)
from jaxgeo.solve.prefix import prefix_sum, prefix_sum_at

# Poses whose covariance is worked out at a time: bounds memory at CHUNK x anchors.
CHUNK = 2048


class Posterior(eqx.Module):
    """What covariances of any poses need: the solved chain and its small system."""

    rows: Float[Array, "r n"]
    system: SmallSystem
    graph: PoseGraph


def posterior(graph: PoseGraph, poses: Poses, glob: Globals) -> Posterior:
    """The posterior at a solution of the graph."""
    lin = linearisation(rebased(graph, poses, glob))
    return Posterior(jnp.stack([*covariance_rows(lin.edges), *globals_rows(lin.edges, graph)]), lin.system, lin.graph)


def pose_covariance(post: Posterior, index: Int[Array, "m"]) -> Float[Array, "m 6 6"]:
    """Covariances of the poses asked for: position error added, rotation error multiplied on the left, grid axes."""
    return _covariance(post, prefix_sum_at(post.rows, index), index)


def all_pose_covariances(post: Posterior) -> Float[Array, "n 6 6"]:
    """The same for every pose of the padded chain, a chunk at a time."""
    n = post.rows.shape[1]
    chunks = max(1, n // CHUNK)
    while n % chunks:
        chunks += 1
    summed = prefix_sum(post.rows)

    def one(chunk: tuple[Array, Array]) -> Array:
        rows, index = chunk
        return _covariance(post, rows.T, index)

    split = summed.T.reshape(chunks, n // chunks, -1), jnp.arange(n).reshape(chunks, n // chunks)
    return jax.lax.map(one, split).reshape(n, 6, 6)


def _covariance(post: Posterior, summed: Float[Array, "r m"], index: Int[Array, "m"]) -> Float[Array, "m 6 6"]:
    system, graph = post.system, post.graph
    own = covariance_blocks(summed[:21])
    influence = globals_blocks(summed[21:], graph)
    k, d, _ = system.jacobian.shape
    m = index.shape[0]
    # Cov(delta_i, anchor l) = S(min(i, a_l)) H_l'; an anchor sees the chain up to the earlier of the two.
    from_anchor = jnp.einsum("lab,ldb->ald", system.chain_covariance, system.jacobian)
    from_pose = jnp.einsum("iab,ldb->iald", own, system.jacobian)
    anchor_first = (graph.anchors.pose_index[None, :] <= index[:, None])[:, None, :, None]
    cross = jnp.where(anchor_first, from_anchor[None], from_pose).reshape(m, 6, k * d)
    influenced = influence * system.globals_variance[None, None]
    cross = cross + influenced @ system.globals_jacobian.T
    prior = own + influenced @ jnp.swapaxes(influence, -1, -2)

    whitened_gauge = jax.scipy.linalg.solve_triangular(system.factor, system.gauge, lower=True)
    whitened = jax.scipy.linalg.solve_triangular(system.factor, cross.reshape(m * 6, k * d).T, lower=True)
    whitened = whitened.T.reshape(m, 6, k * d)
    gauge_covariance = solve_gauge(whitened_gauge.T @ whitened_gauge, jnp.eye(6))
    lever = jnp.eye(6)[None] - whitened @ whitened_gauge
    covariance = prior - whitened @ jnp.swapaxes(whitened, -1, -2)
    covariance = covariance + lever @ gauge_covariance @ jnp.swapaxes(lever, -1, -2)
    # From increments about the origin to errors at the pose itself: dp = dt + dr x p.
    position = jnp.stack([c[index] for c in graph.base.t], axis=-1)
    shift = jnp.broadcast_to(jnp.eye(6), (m, 6, 6)).at[:, :3, 3:].set(-hat(position))
    covariance = shift @ covariance @ jnp.swapaxes(shift, -1, -2)
    return 0.5 * (covariance + jnp.swapaxes(covariance, -1, -2))


def globals_covariance(post: Posterior) -> Float[Array, "g g"]:
    """Posterior covariance of the globals that are in the graph (bias, log-scale)."""
    system = post.system
    cross = (system.globals_jacobian * system.globals_variance[None]).T
    whitened = jax.scipy.linalg.solve_triangular(system.factor, cross.T, lower=True)
    whitened_gauge = jax.scipy.linalg.solve_triangular(system.factor, system.gauge, lower=True)
    gauge_covariance = solve_gauge(whitened_gauge.T @ whitened_gauge, jnp.eye(6))
    lever = whitened.T @ whitened_gauge
    return jnp.diag(system.globals_variance) - whitened.T @ whitened + lever @ gauge_covariance @ lever.T
