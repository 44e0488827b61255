"""The solve on the way: Gauss-Newton under one set of noise variances, from where the last one ended.

Each step linearises once, and its linearisation serves for the covariance as well. Whether another is wanted is read
off the anchors: the residuals that a step foretells are linear in it, those that it leaves are not. Were their
difference all that the next step sees, it would move nothing by more than its norm in standard deviations.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxgeo.graph import soa
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import PoseGraph
from jaxgeo.online import joint
from jaxgeo.online.frame_known import FrameKnown, frame_known
from jaxgeo.online.joint import N_ERRORS, LastPose, at_pose, conditioned
from jaxgeo.online.mean_noise import MeanNoise
from jaxgeo.online.mean_system import MeanSystem, WayState, constants_there, leftover, mean_graph, mean_system
from jaxgeo.online.warm_start import Given, LastSolution, carried_on, chain_of_given
from jaxgeo.solve.anchor_system import Observed
from jaxgeo.solve.drift import BLOCKS
from jaxgeo.solve.ensemble_fold import observe
from jaxgeo.solve.fold import FoldOptions, fold_graph
from jaxgeo.solve.linearise import force_on_edges, increments_from, solve_gauge, solve_small
from jaxgeo.solve.measurement_space import advance
from jaxgeo.solve.prefix import prefix_sum

# A solve on the way ends where another step would move nothing by more than this share of a standard deviation.
SETTLED = 0.1
# Steps before the batch job's own solver, with its damping, is asked instead.
MAX_STEPS = 10


class OnTheWay(eqx.Module):
    """Whether the anchors fix the frame; a solution, its last pose, and what the next solve starts from."""

    known: FrameKnown
    steps: Int[Array, ""]
    settled: Bool[Array, ""]
    last_pose: LastPose
    last: LastSolution


@functools.partial(jax.jit, static_argnames="options")
def solved_on_the_way(
    given: Given, noise: MeanNoise, loss_width: Float[Array, ""], last: LastSolution | None, options: FoldOptions
) -> OnTheWay:
    """Steps until settled, from the last solution or, where there is none, from the coarse fit."""
    graph, observed, origin = _stated(given, noise, loss_width, options)
    known = frame_known(graph)
    poses, log_scale = graph.base, graph.base_globals.log_scale
    if last is not None:
        poses, log_scale = carried_on(last, graph.chain, origin), last.log_scale
    start = WayState(poses, log_scale, jnp.zeros_like(graph.anchors.measured_m))
    once = functools.partial(step, graph=graph, observed=observed, origin_m=origin, noise=noise)

    def again(carry: tuple) -> tuple:
        steps, state, _, _ = carry
        return steps + 1, *once(state)

    def unsettled(carry: tuple) -> Array:
        steps, _, apart, _ = carry
        return known.determined & (steps < MAX_STEPS) & ~(apart < SETTLED)

    _, _, nothing = jax.eval_shape(once, start)
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), nothing)
    steps, state, apart, last_pose = jax.lax.while_loop(
        unsettled, again, (jnp.array(0), start, jnp.array(jnp.inf), nothing)
    )
    carried = LastSolution(state.poses, given.count, origin, state.log_scale)
    return OnTheWay(known, steps, apart < SETTLED, last_pose, carried)


def _stated(
    given: Given, noise: MeanNoise, loss_width: Float[Array, ""], options: FoldOptions
) -> tuple[PoseGraph, Observed | None, Float[Array, "3"]]:
    """The graph as the batch solve states it, at its coarse fit; its origin."""
    chain, table = chain_of_given(given), given.table
    if not noise.pooled:
        graph, _, _, origin = fold_graph(chain, table, noise.white, table.real, loss_width, options)
        return graph, None, origin
    observed, origin = observe(chain, table, table.real, jnp.zeros_like(table.real), loss_width, options)
    return mean_graph(observed.graph, noise), observed, origin


def step(
    state: WayState, graph: PoseGraph, observed: Observed | None, origin_m: Float[Array, "3"], noise: MeanNoise
) -> tuple[WayState, Float[Array, ""], LastPose]:
    """One step; how far what it leaves at the anchors is from what it foretold; and its last pose."""
    system = mean_system(state, graph, observed, noise)
    multiplier, gauge = solve_small(system.small, system.small.residual, jnp.zeros(6))
    new = moved(state, system, multiplier, gauge, graph, noise)
    _, left = leftover(new, graph)
    apart = jnp.linalg.norm(left.reshape(-1) - system.base @ multiplier)
    return new, apart, last_pose(state, new, system, multiplier, graph, origin_m, noise)


def moved(
    state: WayState,
    system: MeanSystem,
    multiplier: Float[Array, "m"],
    gauge: Float[Array, "6"],
    graph: PoseGraph,
    noise: MeanNoise,
) -> WayState:
    """The state that the multipliers foretell: forces on the edges to noise, noise to increments of the poses."""
    small, edges = system.small, system.edges
    k, d, _ = small.jacobian.shape
    force = -jnp.einsum("kda,kd->ka", small.jacobian, multiplier.reshape(k, d))
    pull = edges.backward(*force_on_edges(force, graph))
    trans = soa.sub(soa.mul(edges.variance_trans, pull[0]), system.eps[0])
    rot = soa.sub(soa.mul(edges.variance_rot, pull[1]), system.eps[1])
    constant = -small.globals_variance * (small.globals_jacobian.T @ multiplier)
    bias = [constant[i] for i in range(6)] if graph.terms.bias else [jnp.zeros(())] * 6
    log_scale = constant[6 if graph.terms.bias else 0] if graph.terms.log_scale else state.log_scale
    stretched = log_scale - state.log_scale
    offset = state.offset_m
    if system.turn is not None:
        rot = soa.add(rot, soa.scale(constant[-1], system.turn))
    if system.forgetting is not None:
        forgetting = system.forgetting
        pulled = jnp.einsum("kbac,ka->bc", forgetting.influence, force)
        wander = (noise.wander[None] * (forgetting.rho @ pulled))[forgetting.stretch]
        bias = [bias[i] + wander[:, i] for i in range(6)]
        stretched = stretched + wander[:, 6]
        offset = noise.bounded_m2 * (forgetting.near @ force[:, :3])
    if graph.terms.bias:
        length = edges.length_m
        trans = soa.add(trans, soa.mul((length, length, length), (bias[0], bias[1], bias[2])))
        rot = soa.add(rot, soa.mul((length, length, length), (bias[3], bias[4], bias[5])))
    always = graph.loss_width > 0
    delta = increments_from(edges, gauge, compute_once(always, (trans, rot)), stretched)
    return WayState(advance(state.poses, compute_once(always, prefix_sum(delta))), log_scale, offset)


def last_pose(
    state: WayState,
    new: WayState,
    system: MeanSystem,
    multiplier: Float[Array, "m"],
    graph: PoseGraph,
    origin_m: Float[Array, "3"],
    noise: MeanNoise,
) -> LastPose:
    """The last pose and the constants. The last row of the anchors is padding and hangs on the last pose."""
    small = system.small
    prior, cross = _prior_and_cross(system, graph, noise)
    gauge = jax.scipy.linalg.solve_triangular(small.factor, small.gauge, lower=True)
    lever = jnp.zeros((N_ERRORS, 6)).at[:6].set(jnp.eye(6))
    covariance, _ = conditioned(prior, cross, lever, small.factor, gauge, solve_gauge(gauge.T @ gauge, jnp.eye(6)))
    # Where it was linearised.
    before = jnp.stack([c[-1] for c in state.poses.t])
    t, quat = (jnp.stack([c[-1] for c in part]) for part in (new.poses.t, new.poses.quat))
    return LastPose(t + origin_m, quat, -(cross[6:] @ multiplier), at_pose(before, covariance))


def _prior_and_cross(
    system: MeanSystem, graph: PoseGraph, noise: MeanNoise
) -> tuple[Float[Array, "e e"], Float[Array, "e m"]]:
    """Prior covariance of the errors, and theirs with the anchors' rows; the pose's leaves the bounded error out."""
    small = system.small
    k, d, _ = small.jacobian.shape
    variance, influence = small.globals_variance, system.influence[-1]
    constants = 6 + constants_there(graph, noise)
    on_pose = jnp.einsum("lab,ldb->ald", small.chain_covariance, small.jacobian).reshape(6, k * d)
    on_constants = variance[:, None] * small.globals_jacobian.T
    shared = influence * variance[None]
    prior = jnp.zeros((N_ERRORS, N_ERRORS)).at[:6, :6].set(small.chain_covariance[-1] + shared @ influence.T)
    prior = prior.at[:6, constants].set(shared).at[constants, :6].set(shared.T)
    prior = prior.at[constants, constants].set(variance)
    cross = jnp.zeros((N_ERRORS, k * d)).at[:6].set(on_pose + influence @ on_constants)
    cross = cross.at[constants].set(on_constants)
    if system.forgetting is None:
        return prior, cross
    forgetting, wander = system.forgetting, noise.wander
    here = jnp.einsum("bac,bi->iac", forgetting.influence[-1], forgetting.rho)
    rows = jnp.einsum("lda,lbac->bcld", small.jacobian, forgetting.influence).reshape(BLOCKS, 7, k * d)
    now = slice(joint.WANDER_TRANS.start, joint.BOUNDED.start)
    own = jnp.einsum("bac,bec,c->ae", here, forgetting.influence[-1], wander)
    with_now = here[BLOCKS - 1] * wander[None]
    prior = prior.at[:6, :6].add(own).at[:6, now].set(with_now).at[now, :6].set(with_now.T)
    prior = prior.at[now, now].set(jnp.diag(wander))
    prior = prior.at[joint.BOUNDED, joint.BOUNDED].set(noise.bounded_m2 * jnp.eye(3))
    cross = cross.at[:6].add(jnp.einsum("bac,c,bcm->am", here, wander, rows))
    cross = cross.at[now].set(wander[:, None] * jnp.einsum("b,bcm->cm", forgetting.rho[BLOCKS - 1], rows))
    faded = jnp.einsum("lda,l->ald", small.jacobian[..., :3], forgetting.near[-1]).reshape(3, k * d)
    return prior, cross.at[joint.BOUNDED].set(noise.bounded_m2 * faded)
