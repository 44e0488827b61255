"""The anchors' small system under every component of the noise: what learning and predicting both start from."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgeo.graph.chain import Poses
from jaxgeo.graph.components import ANCHOR
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import Globals, PoseGraph, at_anchors, chain_noise, zero_globals
from jaxgeo.graph.soa import Vec3
from jaxgeo.solve.drift import Drift, covariance_between, drift_at, own_covariance
from jaxgeo.solve.linearise import Edges, anchor_jacobian, edges_at, hat
from jaxgeo.solve.prefix import prefix_sum_at


class Observed(eqx.Module):
    """A graph and what its anchors tell.

    Attributes:
        graph: its noise is not read; `terms.log_scale` must be on.
        known: (k,) 1 where an anchor is used to correct.
        relative: (k,) 1 for an anchor that is not: its visits are measured against their own mean, not the survey.
        location: (k,) equal for visits of one location.
        survey_covariance_m2: (k, 3, 3) shared by visits of one location.
        span_m: path between the first and the last used anchor.
        correlation_m: over which wander and bounded error forget.
    """

    graph: PoseGraph
    known: Float[Array, "k"]
    relative: Float[Array, "k"]
    location: Int[Array, "k"]
    survey_covariance_m2: Float[Array, "k 3 3"]
    span_m: Float[Array, ""]
    correlation_m: Float[Array, ""]


class State(eqx.Module):
    """Poses of the chain, its log-scale, and the bounded error `offset_m` (n, 3 rows) that lies on top of it."""

    poses: Poses
    log_scale: Float[Array, ""]
    offset_m: Vec3


class AnchorSystem(eqx.Module):
    """The anchors' whitened system, one matrix per component; m rows, d an anchor, unused ones rows of the identity.

    Attributes:
        jacobian: (k, d, 6) of the whitened residuals; `point_jacobian` (k, 3, 6) of every marker's position.
        residual: (m,) what the rows would be without noise, c.
        base: (m, m) covariance of the anchors themselves: identity, and what visits of a location share.
        components: (n, m, m) V_c; `cross` (n, 3k, m) of the markers' positions with the rows; `own` (n, k, 3, 3).
        known: (m,) 1 for rows that are used to correct.
        point_m: (k, 3) markers' positions without noise.
        drift: at the anchors.
    """

    jacobian: Float[Array, "k d 6"]
    point_jacobian: Float[Array, "k 3 6"]
    residual: Float[Array, "m"]
    base: Float[Array, "m m"]
    components: Float[Array, "n m m"]
    cross: Float[Array, "n x m"]
    own: Float[Array, "n k 3 3"]
    known: Float[Array, "m"]
    point_m: Float[Array, "k 3"]
    drift: Drift


class ChainLinearised(eqx.Module):
    """The chain at a state: its edges, their noise, their globals."""

    edges: Edges
    eps: tuple[Vec3, Vec3]
    glob: Globals


def globals_of_state(state: State) -> Globals:
    zero = zero_globals()
    return Globals(zero.bias_trans, zero.bias_rot, state.log_scale)


def chain_linearised(state: State, graph: PoseGraph) -> ChainLinearised:
    glob = globals_of_state(state)
    eps = chain_noise(state.poses, glob, graph)
    edges = edges_at(state.poses, eps, glob, jnp.ones(()), graph)
    edges, eps = compute_once(graph.loss_width > 0, (edges, eps))
    return ChainLinearised(edges, eps, glob)


def anchor_system(state: State, chain: ChainLinearised, observed: Observed) -> AnchorSystem:
    """Linearise at a state. Visits that are only relative are measured against their own mean."""
    graph = observed.graph
    at = at_anchors(state.poses, graph)
    together = observed.relative[:, None] * observed.relative[None] * same_location(observed)
    mean = (together @ at.point_m) / jnp.maximum(together.sum(axis=1), 1.0)[:, None]
    # A robust loss weighs what is left over once the bounded error is taken off; the system itself starts without it.
    offset = jnp.stack([c[graph.anchors.pose_index] for c in state.offset_m], axis=-1)
    measured = jnp.where(observed.relative[:, None] > 0, mean, graph.anchors.measured_m) - offset
    jacobian, residual = anchor_jacobian(state.poses, eqx.tree_at(lambda g: g.anchors.measured_m, graph, measured))
    residual = residual - jnp.einsum("kda,ka->kd", jacobian[..., :3], offset)
    k, d, _ = jacobian.shape
    eye = jnp.broadcast_to(jnp.eye(3), (k, 3, 3))
    point_jacobian = jnp.concatenate([eye, -hat(at.point_m)], axis=-1)
    index = graph.anchors.pose_index
    drift = drift_at(chain.edges, graph, index)
    moved = jnp.stack([c for part in chain.edges.forward(*chain.eps) for c in part])
    without = prefix_sum_at(moved, index).T + drift.constant[..., 6] * state.log_scale
    both = jnp.concatenate([jacobian, point_jacobian], axis=1)
    covariance = covariance_between(both, drift, jacobian, drift, observed.correlation_m)
    split = covariance.reshape(-1, k, d + 3, k * d)
    components = split[:, :, :d].reshape(-1, k * d, k * d)
    known = jnp.repeat(observed.known, d)
    used = known + jnp.repeat(observed.relative, d)
    base = jnp.eye(k * d) + shared_survey(jacobian, observed)
    return AnchorSystem(
        jacobian,
        point_jacobian,
        (residual - jnp.einsum("kda,ka->kd", jacobian, without)).reshape(-1),
        base,
        components.at[ANCHOR].set(base * used[:, None] * used[None]),
        split[:, :, d:].reshape(-1, k * 3, k * d),
        own_covariance(point_jacobian, drift, observed.correlation_m),
        known,
        at.point_m - jnp.einsum("kda,ka->kd", point_jacobian, without),
        drift,
    )


def same_location(observed: Observed) -> Float[Array, "k k"]:
    return (observed.location[:, None] == observed.location[None, :]).astype(float)


def shared_survey(jacobian: Float[Array, "k d 6"], observed: Observed) -> Float[Array, "m m"]:
    """Covariance, whitened, that visits of one location have in common: its survey's."""
    weight = jacobian[..., :3]
    survey = 0.5 * (observed.survey_covariance_m2[:, None] + observed.survey_covariance_m2[None, :])
    known = observed.known
    shared = same_location(observed) * known[:, None] * known[None] * (1.0 - jnp.eye(known.shape[0]))
    k, d, _ = jacobian.shape
    out = jnp.einsum("ida,ijab,jeb,ij->idje", weight, survey, weight, shared)
    return out.reshape(k * d, k * d)
