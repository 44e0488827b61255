"""The solve under a fixed noise, on arrays of fixed size, from where the last one ended."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain, Poses
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.pose_graph import Globals, PoseGraph
from jaxgeo.online.frame_known import FrameKnown, frame_known
from jaxgeo.online.joint import BIAS_ROT, BIAS_TRANS, LOG_SCALE, N_ERRORS, LastPose, at_pose, conditioned
from jaxgeo.online.warm_start import LastSolution, carried_on
from jaxgeo.solve.adjoint import Linearisation, linearisation, rebased
from jaxgeo.solve.fold import FoldOptions, fold_graph
from jaxgeo.solve.linearise import globals_vector, solve_gauge
from jaxgeo.solve.measurement_space import MeasurementSpaceLM
from jaxgeo.solve.posterior import all_pose_covariances, posterior
from jaxgeo.solve.solver import Solution, solve_graph


class Framed(eqx.Module):
    """The graph of the anchors so far at its coarse fit, about `origin_m`; and whether they fix the frame."""

    graph: PoseGraph
    origin_m: Float[Array, "3"]
    known: FrameKnown


class Solved(eqx.Module):
    """A solution, its last pose, and what the next solve starts from."""

    solution: Solution
    last_pose: LastPose
    last: LastSolution


@functools.partial(jax.jit, static_argnames="options")
def framed(
    chain: Chain, table: AnchorTable, noise: OdometryNoise, loss_width: Float[Array, ""], options: FoldOptions
) -> Framed:
    """The graph exactly as the batch solve states it."""
    graph, _, _, origin = fold_graph(chain, table, noise, table.real, loss_width, options)
    return Framed(graph, origin, frame_known(graph))


@functools.partial(jax.jit, static_argnames=("max_steps", "solver"))
def solved(
    framed: Framed, count: Array, last: LastSolution | None, max_steps: int, solver: MeasurementSpaceLM
) -> Solved:
    """The optimum from the last solution, or from the coarse fit where there is none."""
    graph = framed.graph
    if last is not None:
        start = carried_on(last, graph.chain, framed.origin_m)
        glob = graph.base_globals
        graph = rebased(graph, start, Globals(glob.bias_trans, glob.bias_rot, last.log_scale))
    found = solve_graph(graph, max_steps, solver)
    lin = linearisation(rebased(graph, found.poses, found.glob))
    return Solved(
        found,
        _last_pose(lin, found, framed.origin_m),
        LastSolution(found.poses, count, framed.origin_m, found.glob.log_scale),
    )


@jax.jit
def covariances(framed: Framed, poses: Poses, glob: Globals) -> Float[Array, "n 6 6"]:
    """Posterior covariance of every pose of the padded chain."""
    return all_pose_covariances(posterior(framed.graph, poses, glob))


def _last_pose(lin: Linearisation, found: Solution, origin_m: Float[Array, "3"]) -> LastPose:
    """The last row of the anchors is padding and hangs on the last pose: the small system has its prior covariance."""
    system, graph = lin.system, lin.graph
    k, d, _ = system.jacobian.shape
    own, influence, variance = system.chain_covariance[-1], lin.influence[-1], system.globals_variance
    from_chain = jnp.einsum("lab,ldb->ald", system.chain_covariance, system.jacobian).reshape(6, k * d)
    on_globals = variance[:, None] * system.globals_jacobian.T
    cross = jnp.concatenate([from_chain + influence @ on_globals, on_globals])
    shared = influence * variance[None]
    prior = jnp.block([[own + shared @ influence.T, shared], [shared.T, jnp.diag(variance)]])
    gauge = jax.scipy.linalg.solve_triangular(system.factor, system.gauge, lower=True)
    lever = jnp.concatenate([jnp.eye(6), jnp.zeros((variance.shape[0], 6))])
    free = solve_gauge(gauge.T @ gauge, jnp.eye(6))
    covariance, _ = conditioned(prior, cross, lever, system.factor, gauge, free)
    t, quat = (jnp.stack([c[-1] for c in part]) for part in (found.poses.t, found.poses.quat))
    place = _places(graph)
    at = at_pose(t, covariance)
    return LastPose(
        t + origin_m,
        quat,
        jnp.zeros(N_ERRORS).at[place[6:]].set(globals_vector(found.glob, graph))[6:],
        jnp.zeros((N_ERRORS, N_ERRORS)).at[place[:, None], place[None, :]].set(at),
    )


def _places(graph: PoseGraph) -> Array:
    """Where the pose and the globals of the graph stand among the errors of `joint`."""
    places = list(range(6))
    if graph.terms.bias:
        places += [*range(BIAS_TRANS.start, BIAS_TRANS.stop), *range(BIAS_ROT.start, BIAS_ROT.stop)]
    if graph.terms.log_scale:
        places += [LOG_SCALE]
    return jnp.array(places)
