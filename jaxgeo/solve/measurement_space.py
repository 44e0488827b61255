"""Levenberg-Marquardt in measurement space: an optimistix solver that sees the graph through `args`.

The solver's state carries the poses and their edge noise; the increments `y` are written once, at the end. Damping acts
on the noise and leaves the gauge alone: with `mu` the white variances and the priors shrink by 1 + mu, and the mean
that they are drawn to moves from zero towards the present values by mu / (1 + mu).
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree

from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Poses
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import Globals, Increments, PoseGraph, chain_noise, cost_at, globals_at, poses_at
from jaxgeo.graph.soa import Vec3
from jaxgeo.solve.linearise import (
    edges_at,
    force_on_edges,
    globals_of,
    globals_vector,
    increments_from,
    small_system,
    solve_small,
)
from jaxgeo.solve.prefix import prefix_sum

# A rejected step multiplies the damping by 8 (from 0: sets 1/8), an accepted one divides it; below 1/64 it is dropped.
_DAMPING_FACTOR = 8.0
_DAMPING_FIRST = 0.125
_DAMPING_LOWEST = 1.0 / 64.0
_DAMPING_HIGHEST = 1e6
# A step is never expected to lower the cost by less than this share of what the last one did: near the optimum it was
# 1e-4 to 4e-3, while the first steps, from far away, lower it a million times more than the next ones.
_FASTEST = 1e-3
# Nor is it expected to move the poses by less than this share of what the last one did. Far from all anchors steps
# shrink ten times each at the optimum, after much faster ones before it.
_FASTEST_MOVE = 0.1
# A next step may move any pose by this much, or lower the cost by this share of what else is enough.
_SETTLED_M = 2e-4
_SETTLED_SHARE = 1e-2


class State(eqx.Module):
    """The last accepted point and what to try next."""

    poses: Poses
    glob: Globals
    eps: tuple[Vec3, Vec3]
    cost: Float[Array, ""]
    decrease: Float[Array, ""]
    move_m: Float[Array, ""]
    damping: Float[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]


def advance(poses: Poses, delta: Float[Array, "6 n"]) -> Poses:
    """`Exp(delta) T`, quaternions renormalised."""
    quat, t = se3_soa.exp((delta[0], delta[1], delta[2]), (delta[3], delta[4], delta[5]))
    q = soa.quat_mul(quat, poses.quat)
    # One Newton step of 1/sqrt from 1: rounding leaves the norm within 1e-15 of it.
    n = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return Poses((q[0] * n, q[1] * n, q[2] * n, q[3] * n), soa.add(soa.rotate(quat, poses.t), t))


def damped_step(state: State, graph: PoseGraph) -> tuple[Poses, Globals]:
    """The trial point: one step of the damped problem, linearised at the accepted point.

    What several consumers share is computed once, not in each: 1.5 times faster at 20 000 poses.
    """
    always = graph.loss_width > 0
    shrink = 1.0 / (1.0 + state.damping)
    edges = edges_at(state.poses, state.eps, state.glob, shrink, graph)
    edges = eqx.tree_at(lambda e: (e.a, e.b), edges, compute_once(always, (edges.a, edges.b)))
    system, drift, influence = small_system(state.poses, state.eps, edges, graph, shrink)
    glob = globals_vector(state.glob, graph)
    # Residual once the noise (bias included) and the globals have gone to the mean that they are drawn to.
    moved = shrink * drift
    if graph.terms.log_scale:
        moved = moved + influence[..., -1] * (shrink * glob[-1])
    c = system.residual - jnp.einsum("kda,ka->kd", system.jacobian, moved).reshape(-1)
    multiplier, delta_0 = solve_small(system, c, jnp.zeros(6))
    shape = system.jacobian.shape
    force = force_on_edges(jnp.einsum("kda,kd->ka", system.jacobian, multiplier.reshape(shape[:2])), graph)
    pull = edges.backward(*force)
    shift = -system.globals_variance * (system.globals_jacobian.T @ multiplier)
    new_glob = globals_of((1.0 - shrink) * glob + shift, graph)
    step = globals_of(shift, graph)
    noise_trans = soa.sub(soa.scale(-shrink, state.eps[0]), soa.mul(edges.variance_trans, pull[0]))
    noise_rot = soa.sub(soa.scale(-shrink, state.eps[1]), soa.mul(edges.variance_rot, pull[1]))
    if graph.terms.bias:
        noise_trans = soa.add(noise_trans, soa.scale(edges.length_m, step.bias_trans))
        noise_rot = soa.add(noise_rot, soa.scale(edges.length_m, step.bias_rot))
    noise = compute_once(always, (noise_trans, noise_rot))
    delta = increments_from(edges, delta_0, noise, new_glob.log_scale - state.glob.log_scale)
    return advance(state.poses, compute_once(always, prefix_sum(delta))), new_glob


def farthest_m(before: Poses, after: Poses) -> Float[Array, ""]:
    """How far the farthest pose goes. Neighbours go alike: one of eight is asked."""
    moved = tuple(new[::8] - old[::8] for new, old in zip(after.t, before.t, strict=True))
    return jnp.sqrt(jnp.max(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]))


class MeasurementSpaceLM(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt whose every step is a dense system of the anchors only; `args` must be the `PoseGraph`.

    Converged: after an undamped step, what a next one would lower the cost by, extrapolated geometrically from the last
    two decreases, is below `rtol * cost + atol`, and it would move no pose by more than 0.2 mm, extrapolated likewise;
    or the former is a hundred times below. (A step that lowers the cost by half a square of s moves nothing by more
    than s standard deviations, but far from all anchors these are metres.) A trial that is not finite, or raises the
    cost, is rejected and the damping raised; damping past 1e6 ends the solve as divergent.
    """

    rtol: float = 1e-9
    atol: float = 1e-12
    norm: Callable[[PyTree], Array] = optx.max_norm

    def init(
        self, fn: Any, y: Increments, args: PoseGraph, options: dict, f_struct: Any, aux_struct: Any, tags: frozenset
    ) -> State:
        poses, glob = poses_at(y, args.base), globals_at(y, args)
        eps = chain_noise(poses, glob, args)
        false, far = jnp.array(False), jnp.array(jnp.inf)
        return State(poses, glob, eps, cost_at(poses, glob, eps, args), far, far, jnp.zeros(()), false, false)

    def step(
        self, fn: Any, y: Increments, args: PoseGraph, options: dict, state: State, tags: frozenset
    ) -> tuple[Increments, State, Any]:
        poses, glob = damped_step(state, args)
        eps = chain_noise(poses, glob, args)
        cost = cost_at(poses, glob, eps, args)
        slack = self.rtol * state.cost + self.atol
        undamped = state.damping == 0
        lower = cost <= state.cost
        decrease = state.cost - cost
        # At the optimum rounding may raise the cost by a hair: that is convergence, and the older point stays.
        next_decrease = jnp.where(lower, decrease * jnp.clip(decrease / state.decrease, _FASTEST, 1.0), -decrease)
        move_m = farthest_m(state.poses, poses)
        next_move_m = move_m * jnp.clip(move_m / state.move_m, _FASTEST_MOVE, 1.0)
        settled = (next_move_m <= _SETTLED_M) | (next_decrease <= _SETTLED_SHARE * slack)
        converged = undamped & jnp.isfinite(cost) & (next_decrease <= slack) & settled
        accept = lower & jnp.isfinite(cost)
        raised = jnp.maximum(state.damping * _DAMPING_FACTOR, _DAMPING_FIRST)
        lowered = jnp.where(state.damping <= _DAMPING_LOWEST, 0.0, state.damping / _DAMPING_FACTOR)
        trial = (poses, glob, eps, cost)
        kept = (state.poses, state.glob, state.eps, state.cost)
        poses, glob, eps, cost = jax.tree.map(lambda new, old: jnp.where(accept, new, old), trial, kept)
        damping = jnp.where(accept, lowered, raised)
        stuck = ~converged & ~accept & (damping > _DAMPING_HIGHEST)
        decrease, move_m = (jnp.where(accept & undamped, last, jnp.inf) for last in (decrease, move_m))
        return y, State(poses, glob, eps, cost, decrease, move_m, damping, converged, stuck), None

    def terminate(
        self, fn: Any, y: Increments, args: PoseGraph, options: dict, state: State, tags: frozenset
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.converged | state.stuck, result

    def postprocess(
        self,
        fn: Any,
        y: Increments,
        aux: Any,
        args: PoseGraph,
        options: dict,
        state: State,
        tags: frozenset,
        result: optx.RESULTS,
    ) -> tuple[Increments, Any, dict[str, Any]]:
        back = soa.quat_conj(args.base.quat)
        turned = soa.quat_mul(state.poses.quat, back)
        trans, rot = se3_soa.log(turned, soa.sub(state.poses.t, soa.rotate(turned, args.base.t)))
        glob = jax.tree.map(jnp.subtract, state.glob, args.base_globals)
        return Increments(trans, rot, glob), aux, {}
