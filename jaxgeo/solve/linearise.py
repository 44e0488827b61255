"""The graph linearised in measurement space: the chain folded into a small dense system of the anchors.

With world-frame increments `T_i <- Exp(delta_i) T_i` a change of edge noise moves every later pose alike,

    delta_i = delta_0 + sum_(k<=i) G_k (dn_k + d_k db) + g_k ds
    G_k = Ad(T_k) J_r(eps_k),   g_k = (R_(k-1) e^s t_k, 0)

so prior covariances of poses are prefix sums `S(min(i, j))`, `S(m) = sum_(k<=m) G_k Q_k G_k'`, and a Gauss-Newton step
is

    (I + H S H' + HD P (HD)') lambda - H_0 delta_0 = c,      H_0' lambda = 0

in which H, whitened, has a few rows per anchor, and `HD P (HD)'` is what the globals (bias, log-scale) of prior P add.
Universal kriging, or best linear unbiased prediction, of the chain from its anchors. The gauge `delta_0` has no prior.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.geometry.robust import robust_weight
from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Poses, previous
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.noise import edge_variances
from jaxgeo.graph.pose_graph import Globals, PoseGraph, at_anchors, whitened_anchor_residual
from jaxgeo.graph.soa import Mat3, Vec3
from jaxgeo.solve.prefix import prefix_sums_of

_UPPER = [(i, j) for i in range(3) for j in range(i, 3)]
_ALL = [(i, j) for i in range(3) for j in range(3)]


class Edges(eqx.Module):
    """What every edge does to the poses behind it: `G = [[a, b], [0, a]]`, its white variances, its scale column."""

    a: Mat3
    b: Mat3
    variance_trans: Vec3
    variance_rot: Vec3
    scale_column: Vec3
    length_m: Array

    def forward(self, trans: Vec3, rot: Vec3) -> tuple[Vec3, Vec3]:
        """`G x`: edge noise to world-frame increments."""
        return soa.add(soa.matvec(self.a, trans), soa.matvec(self.b, rot)), soa.matvec(self.a, rot)

    def backward(self, trans: Vec3, rot: Vec3) -> tuple[Vec3, Vec3]:
        """`G' f`: forces on later poses to forces on the edge noise."""
        at, bt = soa.transpose(self.a), soa.transpose(self.b)
        return soa.matvec(at, trans), soa.add(soa.matvec(bt, trans), soa.matvec(at, rot))


class SmallSystem(eqx.Module):
    """The anchors' dense system, whitened; d rows an anchor, held-out anchors are rows of the identity.

    Attributes:
        jacobian: (k, d, 6) H, derivative of the whitened residual in the anchored pose's increment.
        globals_jacobian: (k*d, g) HD, in bias (translation, rotation) and log-scale, as far as they are in the graph.
        globals_variance: (g,) their prior variances P.
        residual: (k*d,) whitened residual, robust weights applied.
        factor: (k*d, k*d) lower Cholesky factor of M.
        chain_covariance: (k, 6, 6) S at every anchor.
    """

    jacobian: Float[Array, "k d 6"]
    globals_jacobian: Float[Array, "m g"]
    globals_variance: Float[Array, "g"]
    residual: Float[Array, "m"]
    factor: Float[Array, "m m"]
    chain_covariance: Float[Array, "k 6 6"]

    @property
    def gauge(self) -> Float[Array, "m 6"]:
        return self.jacobian.reshape(-1, 6)


def edges_at(poses: Poses, eps: tuple[Vec3, Vec3], glob: Globals, shrink: Array, graph: PoseGraph) -> Edges:
    """`G_k` of every edge, its white variances multiplied by `shrink` (1 where nothing is damped)."""
    series = compute_once(graph.loss_width > 0, se3_soa.right_jacobian_series(eps[1]))
    jac, coupling = se3_soa.right_jacobian(*eps, series)
    rotation = soa.quat_matrix(poses.quat)
    a = soa.matmul(rotation, jac)
    b = soa.mat_add(soa.matmul(rotation, coupling), soa.hat_matmul(poses.t, a))
    trans, rot = edge_variances(graph.noise, graph.chain.length_m, graph.chain.turn_rad)
    if graph.terms.log_scale:
        before = jax.tree.map(previous, poses.quat)
        column = soa.scale(jnp.exp(glob.log_scale), soa.rotate(before, graph.chain.odometry.t))
    else:
        column = jax.tree.map(jnp.zeros_like, poses.t)
    return Edges(a, b, soa.scale(shrink, trans), soa.scale(shrink, rot), column, graph.chain.length_m)


def covariance_rows(edges: Edges) -> list[Array]:
    """The 21 different entries of `G Q G'`, as (n,) rows: rotation, coupling, translation."""
    a_rot, b_rot = soa.scale_columns(edges.a, edges.variance_rot), soa.scale_columns(edges.b, edges.variance_rot)
    a_trans = soa.scale_columns(edges.a, edges.variance_trans)
    rows = [soa.dot(a_rot[i], edges.a[j]) for i, j in _UPPER]
    rows += [soa.dot(b_rot[i], edges.a[j]) for i, j in _ALL]
    rows += [soa.dot(b_rot[i], edges.b[j]) + soa.dot(a_trans[i], edges.a[j]) for i, j in _UPPER]
    return rows


def covariance_blocks(rows: Float[Array, "21 k"]) -> Float[Array, "k 6 6"]:
    """Symmetric 6x6 blocks, (translation, rotation), from summed `covariance_rows`."""

    def symmetric(v: Array) -> Array:
        return jnp.stack([v[0], v[1], v[2], v[1], v[3], v[4], v[2], v[4], v[5]], axis=-1).reshape(-1, 3, 3)

    rot, trans = symmetric(rows[:6]), symmetric(rows[15:21])
    coupling = rows[6:15].T.reshape(-1, 3, 3)
    top = jnp.concatenate([trans, coupling], axis=-1)
    bottom = jnp.concatenate([jnp.swapaxes(coupling, -1, -2), rot], axis=-1)
    return jnp.concatenate([top, bottom], axis=-2)


def globals_rows(edges: Edges, graph: PoseGraph) -> list[Array]:
    """Rows whose prefix sums make D, the influence of the globals on a pose: bias (18 rows), log-scale (3 rows)."""
    rows: list[Array] = []
    if graph.terms.bias:
        rows += [edges.length_m * edges.a[i][j] for i, j in _ALL] + [edges.length_m * edges.b[i][j] for i, j in _ALL]
    if graph.terms.log_scale:
        rows += list(edges.scale_column)
    return rows


def globals_blocks(rows: Float[Array, "r k"], graph: PoseGraph) -> Float[Array, "k 6 g"]:
    """D as (k, 6, g) blocks from summed `globals_rows`."""
    k = rows.shape[1]
    columns = [jnp.zeros((k, 6, 0))]
    if graph.terms.bias:
        a, b = rows[:9].T.reshape(k, 3, 3), rows[9:18].T.reshape(k, 3, 3)
        zero = jnp.zeros_like(a)
        columns.append(jnp.concatenate([jnp.concatenate([a, b], -1), jnp.concatenate([zero, a], -1)], -2))
    if graph.terms.log_scale:
        columns.append(jnp.pad(rows[-3:].T, ((0, 0), (0, 3)))[:, :, None])
    return jnp.concatenate(columns, axis=-1)


def globals_vector(glob: Globals, graph: PoseGraph) -> Float[Array, "g"]:
    """The globals that are in the graph, in the order of D's columns."""
    parts = list(glob.bias_trans) + list(glob.bias_rot) if graph.terms.bias else []
    parts += [glob.log_scale] if graph.terms.log_scale else []
    return jnp.stack(parts) if parts else jnp.zeros((0,))


def globals_of(vector: Float[Array, "g"], graph: PoseGraph) -> Globals:
    """Back from `globals_vector`; what is not in the graph is zero."""
    zero = jnp.zeros(())
    bias = [vector[i] for i in range(6)] if graph.terms.bias else [zero] * 6
    log_scale = vector[-1] if graph.terms.log_scale else zero
    return Globals((bias[0], bias[1], bias[2]), (bias[3], bias[4], bias[5]), log_scale)


def globals_variance(graph: PoseGraph) -> Float[Array, "g"]:
    noise = graph.noise
    parts = [noise.sigma_bias_trans_m_per_m, noise.sigma_bias_rot_rad_per_m] if graph.terms.bias else []
    parts += [noise.sigma_log_scale[None]] if graph.terms.log_scale else []
    return jnp.concatenate(parts) ** 2 if parts else jnp.zeros((0,))


def anchor_jacobian(poses: Poses, graph: PoseGraph) -> tuple[Float[Array, "k d 6"], Float[Array, "k d"]]:
    """Whitened Jacobian and residual of the anchors, robust weights applied."""
    at = at_anchors(poses, graph)
    k = at.point_m.shape[0]
    eye = jnp.broadcast_to(jnp.eye(3), (k, 3, 3))
    jacobian = graph.anchors.sqrt_information @ jnp.concatenate([eye, -hat(at.point_m)], axis=-1)
    residual = whitened_anchor_residual(at, graph)
    if graph.terms.rotation:
        turned = graph.anchors.sqrt_information_rotation @ inverse_right_jacobian(at.rotation_residual_rad)
        turned = turned @ jnp.swapaxes(at.rotation, -1, -2)
        jacobian = jnp.concatenate([jacobian, jnp.concatenate([jnp.zeros_like(turned), turned], -1)], axis=-2)
    if graph.terms.loss != "none":
        weight = jnp.sqrt(robust_weight((residual**2).sum(-1), graph.terms.loss, graph.loss_width))
        jacobian, residual = jacobian * weight[:, None, None], residual * weight[:, None]
    return jacobian, residual


def small_system(
    poses: Poses, eps: tuple[Vec3, Vec3], edges: Edges, graph: PoseGraph, shrink: Array
) -> tuple[SmallSystem, Float[Array, "k 6"], Float[Array, "k 6 g"]]:
    """The anchors' system; the chain's share `sum G eps` of every anchored pose's increment; and D at the anchors."""

    def rows(some: tuple[Edges, tuple[Vec3, Vec3]]) -> list[Array]:
        edges, eps = some
        trans, rot = edges.forward(*eps)
        return [*covariance_rows(edges), *trans, *rot, *globals_rows(edges, graph)]

    summed = prefix_sums_of(rows, (edges, eps), graph.anchors.pose_index)
    chain_covariance = covariance_blocks(summed[:21])
    influence = globals_blocks(summed[27:], graph)
    jacobian, residual = anchor_jacobian(poses, graph)
    k, d, _ = jacobian.shape
    globals_jacobian = jnp.einsum("kda,kag->kdg", jacobian, influence).reshape(k * d, -1)
    variance = globals_variance(graph) * shrink
    m = jnp.eye(k * d) + (globals_jacobian * variance[None]) @ globals_jacobian.T
    m = m + anchor_prior_covariance(jacobian, chain_covariance)
    system = SmallSystem(
        jacobian, globals_jacobian, variance, residual.reshape(-1), jnp.linalg.cholesky(m), chain_covariance
    )
    return system, summed[21:27].T, influence


def anchor_prior_covariance(jacobian: Float[Array, "k d 6"], s: Float[Array, "k 6 6"]) -> Float[Array, "m m"]:
    """`H S(min) H'`: the chain's prior covariance between anchors sorted along it."""
    k, d, _ = jacobian.shape
    spread = jnp.einsum("lab,leb->lae", s, jacobian)
    later = jnp.einsum("jda,lae->jdle", jacobian, spread)  # right wherever l comes first
    index = jnp.arange(k)
    first = (index[None, :] <= index[:, None])[:, None, :, None]
    return jnp.where(first, later, jnp.transpose(later, (2, 3, 0, 1))).reshape(k * d, k * d)


def solve_small(
    system: SmallSystem, c: Float[Array, "m"], gauge_force: Float[Array, "6"]
) -> tuple[Float[Array, "m"], Float[Array, "6"]]:
    """`M lambda - H_0 delta_0 = c`, `H_0' lambda = f`: the multipliers and the gauge's increment."""
    both = jax.scipy.linalg.cho_solve((system.factor, True), jnp.concatenate([system.gauge, c[:, None]], axis=1))
    schur = system.gauge.T @ both[:, :6]
    delta_0 = solve_gauge(schur, gauge_force - system.gauge.T @ both[:, 6])
    return both[:, 6] + both[:, :6] @ delta_0, delta_0


def solve_gauge(information: Float[Array, "6 6"], rhs: Array) -> Array:
    """Solve with the gauge's information matrix, scaled to a unit diagonal first: metres and radians differ by 1e6."""
    d = 1.0 / jnp.sqrt(jnp.diagonal(information))
    factor = jnp.linalg.cholesky(information * d[:, None] * d[None, :])
    column = d if rhs.ndim == 1 else d[:, None]
    return column * jax.scipy.linalg.cho_solve((factor, True), column * rhs)


def force_on_edges(per_anchor: Float[Array, "k 6"], graph: PoseGraph) -> tuple[Vec3, Vec3]:
    """Sum of the anchors' forces at and behind every edge: piecewise constant, looked up."""
    from_here = jnp.concatenate([jnp.cumsum(per_anchor[::-1], axis=0)[::-1], jnp.zeros((1, 6))])
    rows = [from_here[:, i][graph.anchors.later_than] for i in range(6)]
    return (rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5])


def hat(v: Float[Array, "k 3"]) -> Float[Array, "k 3 3"]:
    """Cross-product matrices."""
    z = jnp.zeros_like(v[:, 0])
    rows = [z, -v[:, 2], v[:, 1], v[:, 2], z, -v[:, 0], -v[:, 1], v[:, 0], z]
    return jnp.stack(rows, axis=-1).reshape(-1, 3, 3)


def inverse_right_jacobian(rotation_rad: Float[Array, "k 3"]) -> Float[Array, "k 3 3"]:
    """Inverse right Jacobian of SO(3): how `Log(R)` moves when R is multiplied on the right."""
    w = tuple(rotation_rad[:, i] for i in range(3))
    zero = tuple(jnp.zeros_like(c) for c in w)
    jac, _ = se3_soa.right_jacobian(zero, w)  # type: ignore[arg-type]
    return jnp.linalg.inv(jnp.stack([jnp.stack(row, axis=-1) for row in jac], axis=-2))


def increments_from(
    edges: Edges, delta_0: Float[Array, "6"], noise: tuple[Vec3, Vec3], log_scale: Array
) -> Float[Array, "6 n"]:
    """World-frame increments of the edges from changes of the gauge, the edge noise and the log-scale.

    Their prefix sum is the poses' increments: edge 0 carries the gauge, and has no noise of its own.
    """
    trans, rot = edges.forward(*noise)
    trans = soa.add(trans, soa.scale(log_scale, edges.scale_column))
    rows = jnp.stack([*trans, *rot])
    return rows + jnp.where(jnp.arange(rows.shape[1]) == 0, delta_0[:, None], 0.0)
