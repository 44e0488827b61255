"""Hessian-vector products of the cost at its optimum, without reverse mode.

The coordinates are those of the edges: `delta_i = sum_(k<=i) w_k`, w_0 the gauge. The gradient in them has a closed
form, `G_k^-T W_k^2 n_k` plus the pull of the anchors at and behind the edge, and its derivative along a direction is
one forward-mode pass. At the optimum, where the gradient vanishes, this is the Hessian in any chart. Several times
cheaper than differentiating the residual function twice, which it agrees with to rounding (tested).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Poses, previous
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import (
    Globals,
    Increments,
    PoseGraph,
    at_anchors,
    edge_noise,
    increment_rows,
    increments_of,
    inverse_sigmas,
    poses_at,
    prior_weights,
    robust_scale,
    white_noise,
    whitened_anchor_residual,
)
from jaxgeo.graph.soa import Vec3
from jaxgeo.solve.linearise import force_on_edges
from jaxgeo.solve.prefix import prefix_sum


def gradient_field(poses: Poses, glob: Globals, graph: PoseGraph) -> Increments:
    """Derivative of the cost in the edges' world-frame increments w and the globals."""
    always = graph.loss_width > 0
    before = jax.tree.map(previous, poses)
    eps = compute_once(always, edge_noise(before, poses, glob, graph))
    inverse_sigma = inverse_sigmas(graph)
    white = white_noise(eps, glob, graph)
    on_trans, on_rot = (soa.mul(soa.mul(i, i), n) for i, n in zip(inverse_sigma, white, strict=True))
    on_pose = se3_soa.inverse_right_jacobian_transposed(eps[0], eps[1], on_trans, on_rot)
    body_trans, body_rot = compute_once(always, on_pose)
    # Ad(T)^-T, (translation, rotation): R f_t, and R f_r + t x R f_t
    trans = soa.rotate(poses.quat, body_trans)
    rot = soa.add(soa.rotate(poses.quat, body_rot), soa.cross(poses.t, trans))
    weight = prior_weights(graph)
    on_globals = Globals(
        _prior_force(weight.bias_trans, glob.bias_trans, on_trans, graph),
        _prior_force(weight.bias_rot, glob.bias_rot, on_rot, graph),
        _scale_force(weight.log_scale, glob.log_scale, before, trans, graph),
    )
    pulled = force_on_edges(_anchor_force(poses, graph).T, graph)
    return Increments(soa.add(trans, pulled[0]), soa.add(rot, pulled[1]), on_globals)


def hessian_product(direction: Increments, graph: PoseGraph) -> Increments:
    """Hessian of the cost times a direction, both in edge coordinates, at the graph's base: must be the optimum."""
    return hessian_at(graph)(direction)


def hessian_at(graph: PoseGraph) -> Callable[[Increments], Increments]:
    """The same for many directions: what does not depend on them is worked out once."""
    base, always = graph.base, graph.loss_width > 0
    _, derivative = jax.linearize(lambda poses, glob: gradient_field(poses, glob, graph), base, graph.base_globals)

    def product(direction: Increments) -> Increments:
        delta = compute_once(always, prefix_sum(increment_rows(direction)))
        trans, rot = (delta[0], delta[1], delta[2]), (delta[3], delta[4], delta[5])
        half = soa.scale(0.5, rot)  # type: ignore[arg-type]
        moved = Poses(soa.quat_mul((jnp.zeros_like(rot[0]), *half), base.quat), soa.add(trans, soa.cross(rot, base.t)))
        return derivative(compute_once(always, moved), direction.glob)

    return product


def _anchor_force(poses: Poses, graph: PoseGraph) -> Float[Array, "6 k"]:
    """Derivative of the anchors' share in the increments of the anchored poses."""
    index = graph.anchors.pose_index
    anchored = jax.tree.map(lambda c: c[index], poses)
    k = index.shape[0]
    near = _on_own_poses(graph)

    def cost(step: Array) -> Array:
        at = at_anchors(poses_at(increments_of(step, graph.base_globals), anchored), near)
        whitened = whitened_anchor_residual(at, near)
        return 0.5 * jnp.sum((whitened * robust_scale(whitened, near)[:, None]) ** 2)

    return jax.grad(cost)(jnp.zeros((6, k)))


def _on_own_poses(graph: PoseGraph) -> PoseGraph:
    """The graph whose anchor j hangs on row j of poses gathered at the anchors."""
    return eqx.tree_at(lambda g: g.anchors.pose_index, graph, jnp.arange(graph.anchors.pose_index.shape[0]))


def _prior_force(weight: Vec3, value: Vec3, on_noise: Vec3, graph: PoseGraph) -> Vec3:
    if not graph.terms.bias:
        return jax.tree.map(jnp.zeros_like, value)
    pulled = jax.tree.map(lambda f: jnp.sum(graph.chain.length_m * f), on_noise)
    return soa.sub(soa.mul(soa.mul(weight, weight), value), pulled)


def _scale_force(weight: Array, value: Array, before: Poses, on_pose: Vec3, graph: PoseGraph) -> Array:
    if not graph.terms.log_scale:
        return jnp.zeros_like(value)
    column = soa.scale(jnp.exp(value), soa.rotate(before.quat, graph.chain.odometry.t))
    return weight * weight * value - jnp.sum(soa.dot(column, on_pose))
