"""The restricted likelihood of the anchors, given the odometry noise (Patterson and Thompson 1971).

The anchors' misclosures c ~ N(H_0 delta_0, M(noise)), the gauge delta_0 integrated out with a flat prior:

    -2 log L = e' M^-1 e + log det M + log det(H_0' M^-1 H_0) - log det(W' W),     e = c - H_0 delta_0

all of the small system's size, smooth and differentiable in the noise. Held-out anchors are rows of the identity and
contribute nothing.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph.chain import Poses
from jaxgeo.graph.pose_graph import Globals, PoseGraph, chain_noise
from jaxgeo.solve.linearise import edges_at, globals_vector, small_system


def negative_log_likelihood(graph: PoseGraph, poses: Poses, glob: Globals) -> Float[Array, ""]:
    """Restricted negative log-likelihood of the graph's noise, linearised at the given poses (up to a constant).

    Differentiate it with respect to `graph.noise`; the poses are where it is linearised, not unknowns.
    """
    one = jnp.ones(())
    eps = chain_noise(poses, glob, graph)
    edges = edges_at(poses, eps, glob, one, graph)
    system, drift, influence = small_system(poses, eps, edges, graph, one)
    if graph.terms.log_scale:
        drift = drift + influence[..., -1] * globals_vector(glob, graph)[-1]
    c = system.residual - jnp.einsum("kda,ka->kd", system.jacobian, drift).reshape(-1)
    both = jnp.concatenate([system.gauge, c[:, None]], axis=1)
    whitened = jax.scipy.linalg.solve_triangular(system.factor, both, lower=True)
    gauge, rest = whitened[:, :6], whitened[:, 6]
    information = gauge.T @ gauge
    d = 1.0 / jnp.sqrt(jnp.diagonal(information))
    factor = jnp.linalg.cholesky(information * d[:, None] * d[None, :])
    explained = jax.scipy.linalg.solve_triangular(factor, d * (gauge.T @ rest), lower=True)
    log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(system.factor)))
    log_det_gauge = 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor))) - 2.0 * jnp.sum(jnp.log(d))
    weights = [graph.anchors.sqrt_information]
    if graph.terms.rotation:
        weights.append(graph.anchors.sqrt_information_rotation)
    log_det_weights = sum((_log_determinant(w) for w in weights), start=jnp.zeros(()))
    return 0.5 * (rest @ rest - explained @ explained + log_det + log_det_gauge) - log_det_weights


def _log_determinant(sqrt_information: Float[Array, "k 3 3"]) -> Array:
    """Sum of log-determinants of triangular square roots; held-out ones (zero) left out."""
    diagonal = jnp.diagonal(sqrt_information, axis1=-2, axis2=-1)
    used = diagonal > 0
    return jnp.sum(jnp.where(used, jnp.log(jnp.where(used, diagonal, 1.0)), 0.0))
