"""Solve a pose graph with `optimistix.least_squares`; differentiable in everything the graph holds."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, Int

from jaxgeo.graph.chain import Poses
from jaxgeo.graph.pose_graph import Globals, PoseGraph, globals_at, poses_at, residuals, zero_increments
from jaxgeo.solve.adjoint import AtOptimum, ChainCG, rebased
from jaxgeo.solve.measurement_space import MeasurementSpaceLM

MAX_STEPS = 60
SOLVER = MeasurementSpaceLM()
# An implicit gradient is as good as the optimum that it is taken at: a cost within 1e-9 leaves it 4e-5 off.
SOLVER_FOR_GRADIENTS = MeasurementSpaceLM(rtol=1e-12)


class Solution(eqx.Module):
    """Solved poses.

    Attributes:
        poses: `T_grid_body`, padded.
        glob: bias and log-scale.
        cost: half the sum of squared residuals.
        steps: steps taken, rejected ones included.
        result: optimistix's result code; see `result_words`. Anything but success means: do not use the poses.
    """

    poses: Poses
    glob: Globals
    cost: Float[Array, ""]
    steps: Int[Array, ""]
    result: optx.RESULTS


def solve_graph(graph: PoseGraph, max_steps: int = MAX_STEPS, solver: MeasurementSpaceLM = SOLVER) -> Solution:
    """The optimum, without derivatives. Runs under `jit` and `vmap`; never raises, carries the result code."""
    graph = jax.lax.stop_gradient(graph)
    found = optx.least_squares(residuals, solver, zero_increments(graph), graph, max_steps=max_steps, throw=False)
    # The state's poses are those of `found.value`, without the way through logarithm and exponential.
    state = found.state
    return Solution(state.poses, state.glob, state.cost, found.stats["num_steps"], found.result)


def solve_graph_differentiably(graph: PoseGraph) -> Solution:
    """The optimum with implicit gradients of poses and globals in odometry, anchors and noise.

    Solved once without derivatives, then stated again about its own solution, where the increments are zero and the
    adjoint is one preconditioned linear solve. `cost`, `steps` and `result` carry no gradient. Where the solve did not
    converge the gradient is meaningless: gate on `result`.
    """
    found = solve_graph(graph, solver=SOLVER_FOR_GRADIENTS)
    at_solution = rebased(graph, found.poses, found.glob)
    adjoint = optx.ImplicitAdjoint(linear_solver=ChainCG(jax.lax.stop_gradient(at_solution)))
    y = optx.least_squares(
        residuals, AtOptimum(), zero_increments(graph), at_solution, max_steps=1, throw=False, adjoint=adjoint
    ).value
    return Solution(poses_at(y, at_solution.base), globals_at(y, at_solution), found.cost, found.steps, found.result)


def succeeded(result: optx.RESULTS) -> Array:
    return result == optx.RESULTS.successful


def result_words(result: optx.RESULTS) -> str:
    """`converged`, or what went wrong, of one (unbatched) result."""
    result = jax.tree.map(jnp.asarray, result)
    if bool(result == optx.RESULTS.nonlinear_max_steps_reached):
        return "too many steps"  # optimistix says it in three sentences
    words = optx.RESULTS[result]
    return "converged" if words == "" else str(words)


__all__ = ["MAX_STEPS", "SOLVER", "Solution", "result_words", "solve_graph", "solve_graph_differentiably", "succeeded"]
