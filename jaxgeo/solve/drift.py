"""How every component of the odometry noise reaches the poses: prefix sums along the chain, looked up where asked for.

With world-frame increments an edge's noise n_k moves every later pose alike, by `G_k n_k` (see `linearise`), so a
pose's increment has from a component of unit variance the covariance

    white, axis i     sum_(k <= min) d_k (G_k e_i)(G_k e_i)'
    constant, v       (sum_(k <= i) v_k)(sum_(k <= j) v_k)'         v_k = d_k G_k e_i, scale column, turn column
    wander            sum_(b, b') rho(b, b') V_b(i) V_b'(j)'         V_b(i) the part of the constant's sum in block b
    bounded           rho(i, j) on the position

with rho = exp(-|distance| / correlation length). The wander is constant on each of `BLOCKS` equal stretches of path.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.components import (
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    LOG_TURN,
    N_COMPONENTS,
    N_WHITE,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
)
from jaxgeo.graph.pose_graph import PoseGraph
from jaxgeo.graph.soa import Vec3
from jaxgeo.solve.linearise import Edges
from jaxgeo.solve.prefix import prefix_sum, prefix_sums_of

# Stretches of the path on which a wandering bias is constant: a fraction of its correlation length.
BLOCKS = 64
_UPPER = [(i, j) for i in range(3) for j in range(i, 3)]
# Columns of `Drift.constant` and `Drift.block`: bias of translation (3) and rotation (3), scale, turn scale.
COLUMNS = 8
_BLOCK_COLUMNS = 7


class Drift(eqx.Module):
    """Influence of unit noise on p poses.

    Attributes:
        index: (p,) the poses.
        white: (7, p, 6, 6) covariance of each white component, summed up to the pose.
        constant: (p, 6, 8) influence of each constant.
        block: (p, b, 6, 7) influence of the constants (bias, scale) of each stretch.
        distance_m: (p,) along the path.
        block_length_m: ().
    """

    index: Int[Array, "p"]
    white: Float[Array, "7 p 6 6"]
    constant: Float[Array, "p 6 8"]
    block: Float[Array, "p b 6 7"]
    distance_m: Float[Array, "p"]
    block_length_m: Float[Array, ""]


def path_length_m(graph: PoseGraph) -> Float[Array, "n"]:
    """Distance along the path up to every pose."""
    return prefix_sum(graph.chain.length_m[None])[0]


def block_of_edge(distance_m: Float[Array, "n"]) -> Int[Array, "n"]:
    """The stretch that every edge belongs to, by the distance at its end."""
    share = distance_m / jnp.maximum(distance_m[-1], 1e-300)
    return jnp.clip(jnp.ceil(share * BLOCKS).astype(int) - 1, 0, BLOCKS - 1)


def turn_column(graph: PoseGraph) -> Vec3:
    """Rotation vector of every edge: what a wrong scale of the turns multiplies."""
    zero = jax.tree.map(jnp.zeros_like, graph.chain.odometry.t)
    _, rotation = se3_soa.log(graph.chain.odometry.quat, zero)
    return rotation


def drift_at(edges: Edges, graph: PoseGraph, index: Int[Array, "p"]) -> Drift:
    """The drift's influence on the poses asked for, linearised at the edges."""
    distance = path_length_m(graph)
    per_pose = (edges.a, edges.b, edges.scale_column, edges.length_m, graph.chain.turn_rad, turn_column(graph))
    summed = prefix_sums_of(_rows, per_pose, index)
    ends = jnp.searchsorted(block_of_edge(distance), jnp.arange(BLOCKS), side="right").astype(int) - 1
    at_ends = prefix_sums_of(_block_rows, per_pose, ends)
    constant = summed[102:129]
    return Drift(
        index=index,
        white=_white(summed[:102]),
        constant=_columns(constant),
        block=_split(constant[:21].T, at_ends.T, index, ends),
        distance_m=distance[index],
        block_length_m=distance[-1] / BLOCKS,
    )


def _rows(per_pose: tuple) -> list[Array]:
    """White covariances (18 + 63 + 21 rows), then the constants' columns (9 + 9 + 3 + 6)."""
    a, b, _, d, turn, omega = per_pose
    rows: list[Array] = []
    for axis in range(3):
        rows += [d * a[i][axis] * a[j][axis] for i, j in _UPPER]
    for axis in range(3):
        rows += [d * a[i][axis] * a[j][axis] for i, j in _UPPER]
        rows += [d * b[i][axis] * a[j][axis] for i in range(3) for j in range(3)]
        rows += [d * b[i][axis] * b[j][axis] for i, j in _UPPER]
    rows += [turn * soa.dot(a[i], a[j]) for i, j in _UPPER]
    rows += [turn * soa.dot(b[i], a[j]) for i in range(3) for j in range(3)]
    rows += [turn * soa.dot(b[i], b[j]) for i, j in _UPPER]
    rows += _block_rows(per_pose)
    rows += [*soa.matvec(b, omega), *soa.matvec(a, omega)]
    return rows


def _block_rows(per_pose: tuple) -> list[Array]:
    a, b, scale_column, d, *_ = per_pose
    rows = [d * a[i][j] for i in range(3) for j in range(3)] + [d * b[i][j] for i in range(3) for j in range(3)]
    return [*rows, *scale_column]


def _symmetric(v: Float[Array, "6 p"]) -> Float[Array, "p 3 3"]:
    return jnp.stack([v[0], v[1], v[2], v[1], v[3], v[4], v[2], v[4], v[5]], axis=-1).reshape(-1, 3, 3)


def _white(rows: Float[Array, "102 p"]) -> Float[Array, "7 p 6 6"]:
    parts = []
    for axis in range(3):
        trans = _symmetric(rows[6 * axis : 6 * axis + 6])
        parts.append(jnp.pad(trans, ((0, 0), (0, 3), (0, 3))))
    for part in range(4):
        v = rows[18 + 21 * part : 39 + 21 * part]
        rot, trans = _symmetric(v[:6]), _symmetric(v[15:])
        coupling = v[6:15].T.reshape(-1, 3, 3)
        top = jnp.concatenate([trans, coupling], axis=-1)
        parts.append(jnp.concatenate([top, jnp.concatenate([jnp.swapaxes(coupling, -1, -2), rot], -1)], axis=-2))
    return jnp.stack(parts)


def _bias_and_scale(v: Float[Array, "p 21"]) -> Float[Array, "p 6 7"]:
    """Columns of the translation bias (a; 0), the rotation bias (b; a) and the scale (column; 0)."""
    a, b = v[..., :9].reshape(*v.shape[:-1], 3, 3), v[..., 9:18].reshape(*v.shape[:-1], 3, 3)
    top = jnp.concatenate([a, b, v[..., 18:21, None]], axis=-1)
    bottom = jnp.concatenate([jnp.zeros_like(a), a, jnp.zeros_like(a[..., :1])], axis=-1)
    return jnp.concatenate([top, bottom], axis=-2)


def _columns(v: Float[Array, "27 p"]) -> Float[Array, "p 6 8"]:
    return jnp.concatenate([_bias_and_scale(v[:21].T), v[21:27].T[..., None]], axis=-1)


def _split(
    at: Float[Array, "p 21"], ends: Float[Array, "b 21"], index: Int[Array, "p"], end: Int[Array, "b"]
) -> Float[Array, "p b 6 7"]:
    """The part of a pose's sum that each stretch contributes: `D(min(i, end_b)) - D(min(i, end_(b-1)))`."""
    upto = jnp.where((end[None, :] <= index[:, None])[..., None], ends[None], at[:, None])
    before = jnp.concatenate([jnp.zeros_like(upto[:, :1]), upto[:, :-1]], axis=1)
    return _bias_and_scale(upto - before)


def block_correlation(drift: Drift, correlation_m: Float[Array, ""]) -> Float[Array, "b b"]:
    """`rho` between stretches."""
    step = jnp.arange(BLOCKS).astype(float)
    return jnp.exp(-jnp.abs(step[:, None] - step[None, :]) * drift.block_length_m / correlation_m)


def covariance_between(
    left: Float[Array, "p d 6"], here: Drift, right: Float[Array, "k e 6"], there: Drift, correlation_m: Array
) -> Float[Array, "n pd ke"]:
    """`J_i Cov(pose i, pose j) L_j'` of unit noise, one matrix per component (none for `anchor_factor`, left zero).

    `left`, `right` are derivatives of what is asked for in the poses' world-frame increments.
    """
    p, d, _ = left.shape
    k, e, _ = right.shape
    from_there = jnp.einsum("clab,leb->clae", there.white, right)
    later = jnp.einsum("ida,clae->cidle", left, from_there)
    from_here = jnp.einsum("ida,ciab->cidb", left, here.white)
    earlier = jnp.einsum("cidb,leb->cidle", from_here, right)
    there_first = (there.index[None, :] <= here.index[:, None])[None, :, None, :, None]
    white = jnp.where(there_first, later, earlier).reshape(N_WHITE, p * d, k * e)
    hd = jnp.einsum("ida,iac->idc", left, here.constant).reshape(p * d, COLUMNS)
    ld = jnp.einsum("lea,lac->lec", right, there.constant).reshape(k * e, COLUMNS)

    rho = block_correlation(there, correlation_m)
    ha = jnp.einsum("ida,ibac->cidb", left, here.block).reshape(_BLOCK_COLUMNS, p * d, BLOCKS)
    la = jnp.einsum("lea,lbac->cble", right, there.block).reshape(_BLOCK_COLUMNS, BLOCKS, k * e)
    near = jnp.exp(-jnp.abs(here.distance_m[:, None] - there.distance_m[None, :]) / correlation_m)
    bounded = jnp.einsum("ida,lea,il->idle", left[..., :3], right[..., :3], near).reshape(p * d, k * e)
    constant = jnp.einsum("xc,yc->cxy", hd, ld)
    return _stack(white, constant, ha @ (rho[None] @ la), bounded)


def own_covariance(left: Float[Array, "p d 6"], here: Drift, correlation_m: Array) -> Float[Array, "n p d d"]:
    """The blocks of `covariance_between` of a pose with itself."""
    white = jnp.einsum("ida,ciab,ieb->cide", left, here.white, left)
    hd = jnp.einsum("ida,iac->cid", left, here.constant)
    ha = jnp.einsum("ida,ibac->cidb", left, here.block)
    wander = jnp.einsum("cidb,cieb->cide", ha @ block_correlation(here, correlation_m), ha)
    bounded = left[..., :3] @ jnp.swapaxes(left[..., :3], -1, -2)
    return _stack(white, hd[..., :, None] * hd[..., None, :], wander, bounded)


def _stack(white: Array, constant: Array, wander: Array, bounded: Array) -> Array:
    """One matrix per component, in the order of `COMPONENTS`, from the single columns' matrices."""
    parts = [jnp.zeros_like(bounded)] * N_COMPONENTS
    parts[:N_WHITE] = [white[i] for i in range(N_WHITE)]
    parts[BIAS_TRANS], parts[BIAS_ROT] = constant[:3].sum(axis=0), constant[3:6].sum(axis=0)
    parts[LOG_SCALE], parts[LOG_TURN] = constant[6], constant[7]
    parts[WANDER_TRANS], parts[WANDER_ROT] = wander[:3].sum(axis=0), wander[3:6].sum(axis=0)
    parts[WANDER_SCALE], parts[BOUNDED] = wander[6], bounded
    return jnp.stack(parts)
