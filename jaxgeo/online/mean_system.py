"""The anchors' small system under one set of every noise component.

The same algebra as `jaxgeo.solve.linearise` and `jaxgeo.solve.drift`, for one set alone: its white variances are summed
along the chain as they are, 21 rows instead of one lot for each component. With H the anchors' whitened Jacobians, D
the influence of the constants and V that of the bias of every stretch of the path,

    M = B + H S(min) H' + HD P (HD)' + sum_v p_v HV_v rho (HV_v)' + p_b rho
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxgeo.graph import soa
from jaxgeo.graph.chain import Poses
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import Globals, PoseGraph, chain_noise, zero_globals
from jaxgeo.graph.soa import Vec3
from jaxgeo.online.mean_noise import MeanNoise
from jaxgeo.solve.anchor_system import Observed, shared_survey
from jaxgeo.solve.drift import BLOCKS, block_of_edge, path_length_m, turn_column
from jaxgeo.solve.linearise import (
    Edges,
    SmallSystem,
    anchor_jacobian,
    anchor_prior_covariance,
    covariance_blocks,
    covariance_rows,
    edges_at,
    globals_blocks,
    globals_rows,
)
from jaxgeo.solve.prefix import prefix_sums_of


class WayState(eqx.Module):
    """Poses of the chain, its log-scale, and the bounded error (k, 3) at the anchors, on top of the poses."""

    poses: Poses
    log_scale: Float[Array, ""]
    offset_m: Float[Array, "k 3"]


class Forgetting(eqx.Module):
    """What forgets along the path: wander on equal stretches, bounded error.

    Attributes:
        stretch: (n,) of every edge.
        influence: (k, b, 6, 7) of the wandering bias and scale of each stretch on every anchored pose.
        rho: (b, b) between stretches; `near` (k, k) between anchors.
    """

    stretch: Int[Array, "n"]
    influence: Float[Array, "k b 6 7"]
    rho: Float[Array, "b b"]
    near: Float[Array, "k k"]


class MeanSystem(eqx.Module):
    """The chain and its anchors linearised at a state.

    Attributes:
        edges, eps: of the chain.
        small: the anchors' system, M factorised; its globals are the constants in the graph, last the scale of the
            turns; its residual is what is left once all noise is taken back, c.
        influence: (k, 6, g) of the constants on every anchored pose.
        base: (m, m) covariance of the anchors' own errors.
        turn: rotation vector of every edge, where the scale of the turns is in the noise.
        forgetting: where wander or bounded error is.
    """

    edges: Edges
    eps: tuple[Vec3, Vec3]
    small: SmallSystem
    influence: Float[Array, "k 6 g"]
    base: Float[Array, "m m"]
    turn: Vec3 | None
    forgetting: Forgetting | None


def mean_graph(graph: PoseGraph, noise: MeanNoise) -> PoseGraph:
    """An ensemble's graph, which carries no noise, with that noise and all the constants."""
    terms = dataclasses.replace(graph.terms, bias=True, log_scale=True)
    return dataclasses.replace(graph, noise=noise.white, terms=terms)


def mean_system(state: WayState, graph: PoseGraph, observed: Observed | None, noise: MeanNoise) -> MeanSystem:
    """Linearise at a state. Without `observed`, visits of one location are surveyed apart, as in `correct`."""
    glob = Globals(zero_globals().bias_trans, zero_globals().bias_rot, state.log_scale)
    always = graph.loss_width > 0
    eps = compute_once(always, chain_noise(state.poses, glob, graph))
    edges = edges_at(state.poses, eps, glob, jnp.ones(()), graph)
    edges = eqx.tree_at(lambda e: (e.a, e.b), edges, compute_once(always, (edges.a, edges.b)))
    turn = turn_column(graph) if noise.turns else None
    index = graph.anchors.pose_index
    stretch, ends = _stretches(graph) if noise.forgets else (None, index[:0])
    summed = prefix_sums_of(lambda some: _rows(some, graph), (edges, eps, turn), jnp.concatenate([index, ends]))
    k = index.shape[0]
    influence = _influence(summed[27:, :k], turn, graph)
    jacobian, residual = leftover(state, graph)
    residual = residual - jnp.einsum("kda,ka->kd", jacobian[..., :3], state.offset_m)
    moved = summed[21:27, :k].T
    if graph.terms.log_scale:
        moved = moved + influence[..., 6 if graph.terms.bias else 0] * state.log_scale
    misclosure = (residual - jnp.einsum("kda,ka->kd", jacobian, moved)).reshape(-1)
    forgetting = None
    if stretch is not None:
        forgetting = _forgetting(stretch, ends, summed[27:], graph, noise)
    base = _own_errors(jacobian, observed, noise)
    chain_covariance = covariance_blocks(summed[:21, :k])
    on_constants = jnp.einsum("kda,kag->kdg", jacobian, influence).reshape(misclosure.shape[0], -1)
    variance = noise.constant[constants_there(graph, noise)]
    m = base + (on_constants * variance[None]) @ on_constants.T + anchor_prior_covariance(jacobian, chain_covariance)
    if forgetting is not None:
        m = m + _forgetting_covariance(jacobian, forgetting, noise)
    small = SmallSystem(jacobian, on_constants, variance, misclosure, jnp.linalg.cholesky(m), chain_covariance)
    return MeanSystem(edges, eps, small, influence, base, turn, forgetting)


def leftover(state: WayState, graph: PoseGraph) -> tuple[Float[Array, "k d 6"], Float[Array, "k d"]]:
    """Whitened Jacobians and residuals of the anchors without the bounded error: what a robust loss weighs."""
    measured = graph.anchors.measured_m - state.offset_m
    return anchor_jacobian(state.poses, eqx.tree_at(lambda g: g.anchors.measured_m, graph, measured))


def _rows(some: tuple[Edges, tuple[Vec3, Vec3], Vec3 | None], graph: PoseGraph) -> list[Array]:
    """White covariance (21 rows), noise taken back (6), constants (18 and 3 where they are), scale of the turns (6)."""
    edges, eps, turn = some
    trans, rot = edges.forward(*eps)
    rows = [*covariance_rows(edges), *trans, *rot, *globals_rows(edges, graph)]
    return rows if turn is None else [*rows, *soa.matvec(edges.b, turn), *soa.matvec(edges.a, turn)]


def _influence(summed: Float[Array, "r k"], turn: Vec3 | None, graph: PoseGraph) -> Float[Array, "k 6 g"]:
    if turn is None:
        return globals_blocks(summed, graph)
    return jnp.concatenate([globals_blocks(summed[:-6], graph), summed[-6:].T[..., None]], axis=-1)


def constants_there(graph: PoseGraph, noise: MeanNoise) -> Int[np.ndarray, "g"]:
    """Which of the eight constants the system has."""
    return np.flatnonzero([*[graph.terms.bias] * 6, graph.terms.log_scale, noise.turns])


def _own_errors(jacobian: Float[Array, "k d 6"], observed: Observed | None, noise: MeanNoise) -> Float[Array, "m m"]:
    k, d, _ = jacobian.shape
    own = jnp.eye(k * d)
    if observed is None:
        return own
    own = own + shared_survey(jacobian, observed)
    used = jnp.repeat(observed.known, d)
    return own * (1.0 + noise.anchor_factor * used[:, None] * used[None])


def _stretches(graph: PoseGraph) -> tuple[Int[Array, "n"], Int[Array, "b"]]:
    """The stretch of every edge, and the last pose of every stretch."""
    stretch = block_of_edge(path_length_m(graph))
    return stretch, jnp.searchsorted(stretch, jnp.arange(BLOCKS), side="right").astype(int) - 1


def _forgetting(
    stretch: Int[Array, "n"],
    ends: Int[Array, "b"],
    summed: Float[Array, "r q"],
    graph: PoseGraph,
    noise: MeanNoise,
) -> Forgetting:
    """From the constants' sums at the anchors and, behind them, at the stretches' ends: `D(min(i, end))` and before."""
    index = graph.anchors.pose_index
    k = index.shape[0]
    bias_and_scale = summed[:21].T
    upto = jnp.where((ends[None, :] <= index[:, None])[..., None], bias_and_scale[None, k:], bias_and_scale[:k, None])
    part = upto - jnp.concatenate([jnp.zeros_like(upto[:, :1]), upto[:, :-1]], axis=1)
    influence = globals_blocks(part.reshape(-1, 21).T, graph).reshape(k, BLOCKS, 6, 7)
    distance = path_length_m(graph)
    step = jnp.arange(BLOCKS).astype(float) * (distance[-1] / BLOCKS)
    at = distance[index]
    rho, near = (jnp.exp(-jnp.abs(s[:, None] - s[None, :]) / noise.correlation_m) for s in (step, at))
    return Forgetting(stretch, influence, rho, near)


def _forgetting_covariance(
    jacobian: Float[Array, "k d 6"], forgetting: Forgetting, noise: MeanNoise
) -> Float[Array, "m m"]:
    k, d, _ = jacobian.shape
    rows = jnp.einsum("kda,kbac->kdcb", jacobian, forgetting.influence).reshape(k * d, 7, BLOCKS)
    spread = (rows * noise.wander[None, :, None]) @ forgetting.rho
    place = jacobian[..., :3]
    bounded = noise.bounded_m2 * jnp.einsum("ida,lea,il->idle", place, place, forgetting.near)
    return spread.reshape(k * d, -1) @ rows.reshape(k * d, -1).T + bounded.reshape(k * d, k * d)
