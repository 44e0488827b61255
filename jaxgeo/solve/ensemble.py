"""Correct a trajectory under everything that is known of its noise: the mean over weighted sets of noise values.

Every set q of an ensemble makes a prediction of its own, in measurement space (`linearise`),

    M_q = R + sum_c sigma_qc^2 V_c,       M_q lambda_q - H_0 delta_q = c,      H_0' lambda_q = 0

whose forces are linear in the sigma^2 of each component. So the mean over the sets costs one pass along the chain, with
the mean forces `sum_q w_q sigma_qc^2 H' lambda_q` of each component. A step moves the poses by the mean; where it moves
nothing any more, each set's prediction is linearised at their mean. For one set that is the Gauss-Newton solution.
Covariances are the sets' mean and the spread between their predictions.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Poses
from jaxgeo.graph.components import (
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    LOG_TURN,
    N_WHITE,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
    NoiseEnsemble,
)
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import PoseGraph
from jaxgeo.graph.soa import Vec3
from jaxgeo.solve.anchor_system import AnchorSystem, ChainLinearised, Observed, State
from jaxgeo.solve.drift import Drift, block_correlation, block_of_edge, path_length_m, turn_column
from jaxgeo.solve.linearise import Edges, solve_gauge
from jaxgeo.solve.prefix import prefix_sum


class SetSolution(eqx.Module):
    """One set's prediction.

    Attributes:
        multiplier: (m,) lambda; `gauge` (6,) delta_0; `gauge_covariance` (6, 6).
        whitened_gauge: (m, 6) and `factor` (m, m): of M, whose rows without coordinates are the identity's.
        point_m: (k, 3) markers' positions and `point_covariance_m2` (k, 3, 3).
    """

    multiplier: Float[Array, "m"]
    gauge: Float[Array, "6"]
    gauge_covariance: Float[Array, "6 6"]
    whitened_gauge: Float[Array, "m 6"]
    factor: Float[Array, "m m"]
    point_m: Float[Array, "k 3"]
    point_covariance_m2: Float[Array, "k 3 3"]


def solve_set(system: AnchorSystem, sigma: Float[Array, "n"]) -> SetSolution:
    """One set's small system, and what it predicts for every marker."""
    variance = sigma**2
    both = system.known[:, None] * system.known[None]
    base = jnp.where(both > 0, system.base, jnp.eye(both.shape[0]))
    factor = jnp.linalg.cholesky(base + jnp.einsum("c,cxy->xy", variance, system.components) * both)
    h = system.jacobian.reshape(-1, 6) * system.known[:, None]
    c = system.residual * system.known
    cross = jnp.einsum("c,cxy->xy", variance, system.cross) * system.known[None]
    rhs = jnp.concatenate([h, c[:, None], cross.T], axis=1)
    whitened = jax.scipy.linalg.solve_triangular(factor, rhs, lower=True)
    wh, wc, wx = whitened[:, :6], whitened[:, 6], whitened[:, 7:]
    gauge_covariance = solve_gauge(wh.T @ wh, jnp.eye(6))
    gauge = -gauge_covariance @ (wh.T @ wc)
    left = wc + wh @ gauge
    multiplier = jax.scipy.linalg.solve_triangular(factor, left, lower=True, trans=1)
    k = system.point_m.shape[0]
    shift = (system.point_jacobian @ gauge) - (wx.T @ left).reshape(k, 3)
    wx = wx.T.reshape(k, 3, -1)
    lever = system.point_jacobian - wx @ wh
    own = jnp.einsum("c,ckab->kab", variance, system.own)
    covariance = own - wx @ jnp.swapaxes(wx, -1, -2) + lever @ gauge_covariance @ jnp.swapaxes(lever, -1, -2)
    return SetSolution(multiplier, gauge, gauge_covariance, wh, factor, system.point_m + shift, covariance)


def mixture(
    mean: Float[Array, "q k d"], covariance: Float[Array, "q k d d"], weight: Float[Array, "q"]
) -> tuple[Float[Array, "k d"], Float[Array, "k d d"]]:
    """Mean and covariance of weighted predictions, the spread between them included."""
    centre = jnp.einsum("q,qkd->kd", weight, mean)
    apart = mean - centre[None]
    spread = jnp.einsum("q,qkd,qke->kde", weight, apart, apart)
    return centre, jnp.einsum("q,qkde->kde", weight, covariance) + spread


def ensemble_step(
    state: State,
    chain: ChainLinearised,
    system: AnchorSystem,
    solved: SetSolution,
    noise: NoiseEnsemble,
    observed: Observed,
) -> State:
    """Move the poses to the mean of the sets' predictions (`solved` has a leading axis of sets)."""
    graph, edges = observed.graph, chain.edges
    k, d, _ = system.jacobian.shape
    share = noise.weight[:, None] * noise.sigma**2
    multiplier = solved.multiplier
    force = jnp.einsum("kda,qkd->qka", system.jacobian, multiplier.reshape(-1, k, d))
    drift = system.drift
    on_constant = -jnp.einsum("qc,kac,qka->c", share[:, _constant_components()], drift.constant, force)
    rho = block_correlation(drift, observed.correlation_m)
    on_block = -jnp.einsum("qc,kbac,qka->bc", share[:, _block_components()], drift.block, force)
    on_block = rho @ on_block
    trans, rot = _edge_noise(edges, jnp.einsum("qc,qka->cka", share[:, :N_WHITE], force), graph)
    block = block_of_edge(path_length_m(graph))
    bias = on_constant[:6, None] + on_block[:, :6].T[:, block]
    length = edges.length_m
    omega = turn_column(graph)
    trans = soa.add(trans, soa.scale(length, (bias[0], bias[1], bias[2])))
    rot = soa.add(rot, soa.scale(length, (bias[3], bias[4], bias[5])))
    rot = soa.add(rot, soa.scale(on_constant[7], omega))
    log_scale = on_constant[6]
    change = soa.sub(trans, chain.eps[0]), soa.sub(rot, chain.eps[1])
    moved_trans, moved_rot = edges.forward(*compute_once(graph.loss_width > 0, change))
    stretch = log_scale - state.log_scale + on_block[:, 6][block]
    rows = jnp.stack([*soa.add(moved_trans, soa.scale(stretch, edges.scale_column)), *moved_rot])
    gauge = noise.weight @ solved.gauge
    rows = rows + jnp.where(jnp.arange(rows.shape[1]) == 0, gauge[:, None], 0.0)
    delta = prefix_sum(rows)
    quat, t = se3_soa.exp((delta[0], delta[1], delta[2]), (delta[3], delta[4], delta[5]))
    q = soa.quat_mul(quat, state.poses.quat)
    norm = jnp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    poses = Poses((q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm), soa.add(soa.rotate(quat, state.poses.t), t))
    on_bounded = -jnp.einsum("q,qka->ka", share[:, BOUNDED], force[..., :3])
    return State(poses, log_scale, bounded_offset(on_bounded, drift, observed))


def _constant_components() -> Array:
    return jnp.array([BIAS_TRANS] * 3 + [BIAS_ROT] * 3 + [LOG_SCALE, LOG_TURN])


def _block_components() -> Array:
    return jnp.array([WANDER_TRANS] * 3 + [WANDER_ROT] * 3 + [WANDER_SCALE])


def _edge_noise(edges: Edges, force: Float[Array, "7 k 6"], graph: PoseGraph) -> tuple[Vec3, Vec3]:
    """White noise of every edge from the forces of the anchors behind it, each component with its own."""
    behind = jnp.concatenate([jnp.cumsum(force[:, ::-1], axis=1)[:, ::-1], jnp.zeros((N_WHITE, 1, 6))], axis=1)
    at = behind[:, graph.anchors.later_than]
    length, turn = edges.length_m, graph.chain.turn_rad

    def pull(component: int) -> tuple[Vec3, Vec3]:
        f = [at[component, :, i] for i in range(6)]
        return edges.backward((f[0], f[1], f[2]), (f[3], f[4], f[5]))

    trans = tuple(-length * pull(axis)[0][axis] for axis in range(3))
    turned = pull(6)[1]
    rot = tuple(-length * pull(3 + axis)[1][axis] - turn * turned[axis] for axis in range(3))
    return trans, rot  # type: ignore[return-value]


def bounded_offset(force: Float[Array, "k 3"], drift: Drift, observed: Observed) -> Vec3:
    """`sum_j rho(i, j) force_j` at every pose: two sweeps over the anchors, then a decay to the pose."""
    graph = observed.graph
    s = drift.distance_m
    near = jnp.exp(-jnp.abs(s[:, None] - s[None, :]) / observed.correlation_m)
    order = jnp.arange(s.shape[0])
    left = jnp.where(order[None, :] <= order[:, None], near, 0.0) @ force
    right = jnp.where(order[None, :] >= order[:, None], near, 0.0) @ force
    pad = jnp.zeros((1, 3))
    distance = path_length_m(graph)
    count = graph.anchors.later_than
    # `later_than` counts the anchors before a pose; one at the pose itself is the next one.
    before, after = jnp.concatenate([pad, left])[count], jnp.concatenate([right, pad])[count]
    s_before, s_after = jnp.concatenate([s[:1], s])[count], jnp.concatenate([s, s[-1:]])[count]
    fade = jnp.exp(-(distance - s_before) / observed.correlation_m)
    rise = jnp.exp(-(s_after - distance) / observed.correlation_m)
    rows = [
        jnp.where(count > 0, fade * before[:, i], 0.0) + jnp.where(count < s.shape[0], rise * after[:, i], 0.0)
        for i in range(3)
    ]
    return rows[0], rows[1], rows[2]
