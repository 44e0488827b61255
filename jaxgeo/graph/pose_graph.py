"""The pose graph as an ordinary least-squares problem: residuals of pose increments, whitened.

    odometry k:  T_k = T_(k-1) O_k(s) Exp(eps_k),  (eps_k - d_k b) / sigma_k
    anchor j:    W_j (R l_j + t - m_j),  and  V_j Log(P_j' R)  where the marker's rotation was surveyed
    globals:     b / sigma_b,  s / sigma_s

with O_k(s) the odometry, its translation scaled by e^s, and d_k the edge's length. The first pose is free.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgeo.geometry.robust import RobustKind, robust_rho
from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Chain, Poses, previous, relative_motion
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.noise import OdometryNoise, edge_variances
from jaxgeo.graph.soa import Vec3


class Terms(eqx.Module):
    """What a graph contains beyond white odometry noise and position anchors; each choice compiles its own program."""

    rotation: bool = eqx.field(static=True, default=False)
    log_scale: bool = eqx.field(static=True, default=False)
    bias: bool = eqx.field(static=True, default=False)
    loss: RobustKind = eqx.field(static=True, default="none")


class AnchorRows(eqx.Module):
    """Anchors as the solver sees them, padded to k, sorted by pose index; an anchor of zero information is held out.

    Attributes:
        pose_index: (k,) poses they hang on.
        later_than: (n,) number of anchors that lie before pose i.
        lever_arm_m: (k, 3) body frame.
        measured_m: (k, 3) surveyed positions, local frame.
        sqrt_information: (k, 3, 3) W with W'W the inverse covariance of the position residual, grid axes.
        measured_rotation: (k, 3, 3) body-to-grid rotations that the surveyed marker rotations imply.
        sqrt_information_rotation: (k, 3, 3) of the rotation residual, body axes.
    """

    pose_index: Int[Array, "k"]
    later_than: Int[Array, "n"]
    lever_arm_m: Float[Array, "k 3"]
    measured_m: Float[Array, "k 3"]
    sqrt_information: Float[Array, "k 3 3"]
    measured_rotation: Float[Array, "k 3 3"]
    sqrt_information_rotation: Float[Array, "k 3 3"]


class Globals(eqx.Module):
    """Unknowns of the whole session: constant bias (translation, rotation) per metre, and log-scale of the odometry."""

    bias_trans: Vec3
    bias_rot: Vec3
    log_scale: Float[Array, ""]


class PoseGraph(eqx.Module):
    """Everything the residuals need. Increments are taken about `base` and `base_globals`.

    Attributes:
        loss_width: where the robust loss on an anchor's whitened residual begins.
    """

    chain: Chain
    anchors: AnchorRows
    noise: OdometryNoise
    base: Poses
    base_globals: Globals
    loss_width: Float[Array, ""]
    terms: Terms


class Increments(eqx.Module):
    """The unknowns: world-frame increments `T_i = Exp(y_i) base_i` and what is added to the globals."""

    trans: Vec3
    rot: Vec3
    glob: Globals


def zero_globals() -> Globals:
    zero = jnp.zeros(())
    return Globals((zero, zero, zero), (zero, zero, zero), zero)


def zero_increments(graph: PoseGraph) -> Increments:
    zero = jnp.zeros_like(graph.chain.length_m)
    return Increments((zero, zero, zero), (zero, zero, zero), zero_globals())


def increments_of(rows: Float[Array, "6 n"], glob: Globals) -> Increments:
    """Increments from stacked rows, (translation, rotation)."""
    return Increments((rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5]), glob)


def increment_rows(y: Increments) -> Float[Array, "6 n"]:
    """Back to stacked rows."""
    return jnp.stack([*y.trans, *y.rot])


def poses_at(y: Increments, base: Poses) -> Poses:
    """`Exp(y) base`."""
    quat, t = se3_soa.exp(y.trans, y.rot)
    return Poses(soa.quat_mul(quat, base.quat), soa.add(soa.rotate(quat, base.t), t))


def globals_at(y: Increments, graph: PoseGraph) -> Globals:
    base = graph.base_globals
    return Globals(
        soa.add(base.bias_trans, y.glob.bias_trans),
        soa.add(base.bias_rot, y.glob.bias_rot),
        base.log_scale + y.glob.log_scale,
    )


def edge_noise(before: Poses, here: Poses, glob: Globals, graph: PoseGraph) -> tuple[Vec3, Vec3]:
    """`eps_k = Log(O_k(s)^-1 T_(k-1)^-1 T_k)` of every edge, from the poses at its two ends."""
    odometry = graph.chain.odometry
    moved = compute_once(graph.loss_width > 0, relative_motion(before, here))
    expected = soa.scale(jnp.exp(glob.log_scale), odometry.t) if graph.terms.log_scale else odometry.t
    back = soa.quat_conj(odometry.quat)
    return se3_soa.log(soa.quat_mul(back, moved.quat), soa.rotate(back, soa.sub(moved.t, expected)))


def chain_noise(poses: Poses, glob: Globals, graph: PoseGraph) -> tuple[Vec3, Vec3]:
    """`edge_noise` of the chain that the poses form; for derivatives see `residuals`."""
    return edge_noise(jax.tree.map(previous, poses), poses, glob, graph)


def white_noise(eps: tuple[Vec3, Vec3], glob: Globals, graph: PoseGraph) -> tuple[Vec3, Vec3]:
    """Edge noise without the constant bias."""
    if not graph.terms.bias:
        return eps
    d = graph.chain.length_m
    return soa.sub(eps[0], soa.scale(d, glob.bias_trans)), soa.sub(eps[1], soa.scale(d, glob.bias_rot))


def inverse_sigmas(graph: PoseGraph) -> tuple[Vec3, Vec3]:
    """One over the standard deviation of every edge's white noise; 0 for padding."""

    def invert(variance: Array) -> Array:
        real = variance > 0
        return jnp.where(real, 1.0 / jnp.sqrt(jnp.where(real, variance, 1.0)), 0.0)

    trans, rot = edge_variances(graph.noise, graph.chain.length_m, graph.chain.turn_rad)
    return jax.tree.map(invert, (trans, rot))


class AtAnchors(eqx.Module):
    """The anchored poses and their unwhitened residuals."""

    rotation: Float[Array, "k 3 3"]
    point_m: Float[Array, "k 3"]
    residual_m: Float[Array, "k 3"]
    rotation_residual_rad: Float[Array, "k 3"]


def at_anchors(poses: Poses, graph: PoseGraph) -> AtAnchors:
    """Predicted marker positions and rotations at the anchored poses."""
    a = graph.anchors
    quat = jax.tree.map(lambda c: c[a.pose_index], poses.quat)
    rotation = jnp.stack([jnp.stack(row, axis=-1) for row in soa.quat_matrix(quat)], axis=-2)
    lever = jnp.einsum("kij,kj->ki", rotation, a.lever_arm_m)
    point = lever + jnp.stack([c[a.pose_index] for c in poses.t], axis=-1)
    if graph.terms.rotation:
        turn = jnp.einsum("kji,kjl->kil", a.measured_rotation, rotation)
        rotation_residual = log_rotation(turn)
    else:
        rotation_residual = jnp.zeros_like(point)
    return AtAnchors(rotation, point, point - a.measured_m, rotation_residual)


def whitened_anchor_residual(at: AtAnchors, graph: PoseGraph) -> Float[Array, "k d"]:
    """Whitened residuals, d = 3 (position) or 6 (position, rotation), before the robust loss."""
    a = graph.anchors
    position = jnp.einsum("kij,kj->ki", a.sqrt_information, at.residual_m)
    if not graph.terms.rotation:
        return position
    turned = jnp.einsum("kij,kj->ki", a.sqrt_information_rotation, at.rotation_residual_rad)
    return jnp.concatenate([position, turned], axis=-1)


def log_rotation(matrix: Float[Array, "k 3 3"]) -> Float[Array, "k 3"]:
    """Rotation vectors of a few rotation matrices, by way of the largest quaternion component (Shepperd 1978)."""
    m = matrix
    diagonal = jnp.stack([m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]], axis=-1)
    trace = diagonal.sum(axis=-1)
    skew = jnp.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=-1)
    symmetric = m + jnp.swapaxes(m, -1, -2)
    # Row i is 4 q_i q for q = (w, x, y, z); any row with q_i away from zero gives q.
    first = jnp.concatenate([(1 + trace)[:, None], skew], axis=-1)
    own = jnp.eye(3)[None] * (1 - trace[:, None] + 2 * diagonal)[:, :, None]
    rest = jnp.concatenate([skew[:, :, None], symmetric * (1 - jnp.eye(3))[None] + own], axis=-1)
    rows = jnp.concatenate([first[:, None], rest], axis=1)
    pick = jnp.argmax(jnp.concatenate([trace[:, None], diagonal], axis=-1), axis=-1)
    q = jnp.take_along_axis(rows, pick[:, None, None], axis=1)[:, 0]
    q = q / jnp.sqrt((q * q).sum(axis=-1, keepdims=True))
    zero = jnp.zeros_like(q[:, 0])
    _, rotation = se3_soa.log((q[:, 0], q[:, 1], q[:, 2], q[:, 3]), (zero, zero, zero))
    return jnp.stack(rotation, axis=-1)


def _times(inverse_sigma: Vec3, value: Vec3) -> Vec3:
    return soa.mul(inverse_sigma, value)


def prior_weights(graph: PoseGraph) -> Globals:
    """One over the prior's standard deviation of every global; 0 where the prior is 0 and the global stays 0."""

    def invert(sigma: Array) -> Array:
        return jnp.where(sigma > 0, 1.0 / jnp.where(sigma > 0, sigma, 1.0), 0.0)

    trans, rot = invert(graph.noise.sigma_bias_trans_m_per_m), invert(graph.noise.sigma_bias_rot_rad_per_m)
    return Globals((trans[0], trans[1], trans[2]), (rot[0], rot[1], rot[2]), invert(graph.noise.sigma_log_scale))


def robust_scale(whitened: Float[Array, "k d"], graph: PoseGraph) -> Float[Array, "k"]:
    """Factor that turns a whitened residual r into one whose square is rho(|r|^2)."""
    s = (whitened * whitened).sum(axis=-1)
    there = s > 0
    s_safe = jnp.where(there, s, 1.0)
    return jnp.where(there, jnp.sqrt(robust_rho(s_safe, graph.terms.loss, graph.loss_width) / s_safe), 1.0)


def residuals(y: Increments, graph: PoseGraph) -> dict[str, tuple[Array, ...]]:
    """All whitened residuals at increments y: the function that is handed to `optimistix.least_squares`."""
    poses, glob = poses_at(y, graph.base), globals_at(y, graph)
    # The neighbours come from shifted unknowns, not from shifted poses: XLA repeats what lies before a shift in every
    # fused derivative behind it (a Hessian-vector product of 1829 poses took 10 s instead of 2 ms).
    before_y = Increments(jax.tree.map(previous, y.trans), jax.tree.map(previous, y.rot), y.glob)
    before = poses_at(before_y, jax.tree.map(previous, graph.base))
    return residuals_at(poses, glob, edge_noise(before, poses, glob, graph), graph)


def residuals_at(poses: Poses, glob: Globals, eps: tuple[Vec3, Vec3], graph: PoseGraph) -> dict[str, tuple[Array, ...]]:
    """The same at given poses and globals, their edge noise known."""
    inverse_sigma = inverse_sigmas(graph)
    white = white_noise(eps, glob, graph)
    anchor = whitened_anchor_residual(at_anchors(poses, graph), graph)
    if graph.terms.loss != "none":
        anchor = anchor * robust_scale(anchor, graph)[:, None]
    weight = prior_weights(graph)
    found: dict[str, tuple[Array, ...]] = {
        "translation": _times(inverse_sigma[0], white[0]),
        "rotation": _times(inverse_sigma[1], white[1]),
        "anchor": (anchor,),
    }
    if graph.terms.bias:
        found["bias"] = _times(weight.bias_trans, glob.bias_trans) + _times(weight.bias_rot, glob.bias_rot)
    if graph.terms.log_scale:
        found["log_scale"] = (weight.log_scale * glob.log_scale,)
    return found


def cost_at(poses: Poses, glob: Globals, eps: tuple[Vec3, Vec3], graph: PoseGraph) -> Float[Array, ""]:
    """Half the sum of squared residuals."""
    found = residuals_at(poses, glob, eps, graph)
    return 0.5 * sum((jnp.sum(r * r) for rows in found.values() for r in rows), start=jnp.zeros(()))
