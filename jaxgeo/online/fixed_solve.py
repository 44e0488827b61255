"""The batch job's own problem under a fixed noise, on arrays of fixed size, from where the last solve ended."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph.chain import Poses
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.pose_graph import Globals
from jaxgeo.online.frame_known import FrameKnown, frame_known
from jaxgeo.online.joint import LastPose
from jaxgeo.online.mean_noise import mean_noise
from jaxgeo.online.mean_solve import step
from jaxgeo.online.mean_system import WayState
from jaxgeo.online.warm_start import Given, LastSolution, carried_on, chain_of_given
from jaxgeo.solve.adjoint import rebased
from jaxgeo.solve.fold import FoldOptions, fold_graph
from jaxgeo.solve.posterior import all_pose_covariances, posterior
from jaxgeo.solve.solver import SOLVER_FOR_GRADIENTS, Solution, solve_graph

# Closer to the optimum than the batch job goes, so that the two differ by no more than the batch job's own tolerance.
SOLVER_FINAL = SOLVER_FOR_GRADIENTS


class Solved(eqx.Module):
    """Whether the anchors fix the frame; a solution, its last pose, and what the next solve starts from."""

    known: FrameKnown
    solution: Solution
    last_pose: LastPose
    last: LastSolution


@functools.partial(jax.jit, static_argnames="options")
def solved(
    given: Given, noise: OdometryNoise, loss_width: Float[Array, ""], last: LastSolution | None, options: FoldOptions
) -> Solved:
    """The optimum from the last solution, or from the coarse fit where there is none."""
    table = given.table
    graph, _, _, origin = fold_graph(chain_of_given(given), table, noise, table.real, loss_width, options)
    known = frame_known(graph)
    if last is not None:
        start = carried_on(last, graph.chain, origin)
        glob = graph.base_globals
        graph = rebased(graph, start, Globals(glob.bias_trans, glob.bias_rot, last.log_scale))
    found = solve_graph(graph, options.max_steps, SOLVER_FINAL)
    state = WayState(found.poses, found.glob.log_scale, jnp.zeros_like(graph.anchors.measured_m))
    # Only for what is known there: what the step would still move is below the solver's tolerance.
    _, _, last_pose = step(state, graph, None, origin, mean_noise(noise))
    return Solved(known, found, last_pose, LastSolution(found.poses, given.count, origin, found.glob.log_scale))


@functools.partial(jax.jit, static_argnames="options")
def covariances(
    given: Given, noise: OdometryNoise, loss_width: Float[Array, ""], poses: Poses, glob: Globals, options: FoldOptions
) -> Float[Array, "n 6 6"]:
    """Posterior covariance of every pose of the padded chain."""
    table = given.table
    graph, *_ = fold_graph(chain_of_given(given), table, noise, table.real, loss_width, options)
    return all_pose_covariances(posterior(graph, poses, glob))
