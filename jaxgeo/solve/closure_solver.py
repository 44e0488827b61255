"""Levenberg-Marquardt for large graphs: an optimistix solver whose steps are inexact, by conjugate gradients.

As in measurement space, damping acts on the noise, here of a spanning tree's edges, and leaves the gauge alone.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Poses
from jaxgeo.graph.closure_graph import ClosureGraph, closure_noise, edge_costs, squared_norms
from jaxgeo.graph.soa import Vec3
from jaxgeo.solve.closure_cg import solve_joints
from jaxgeo.solve.closure_linearise import all_increments, condensed, on_joints
from jaxgeo.solve.measurement_space import advance

# A rejected step multiplies the damping by 8 (from 0: sets 1/8), an accepted one divides it; below 1/64 it is dropped.
_DAMPING_FACTOR = 8.0
_DAMPING_FIRST = 0.125
_DAMPING_LOWEST = 1.0 / 64.0
_DAMPING_HIGHEST = 1e6
# Relative accuracy of a step, in energy: no better than the last step's own progress makes worth it (Eisenstat and
# Walker, SIAM J. Sci. Comput. 1996, choice 2), between these.
LOOSEST = 1e-2
_TIGHTEST = 1e-4


# Choice 2's exponent; energies are squares already, as decreases are.
_FORCING_POWER = (1.0 + 5.0**0.5) / 2.0


class ClosureState(eqx.Module):
    """The last accepted point and what to try next."""

    poses: Poses
    noise: tuple[Vec3, Vec3]
    cost: Float[Array, ""]
    damping: Float[Array, ""]
    forcing: Float[Array, ""]
    expected: Float[Array, ""]
    cg_steps: Int[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]


class ClosureLM(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt on a `ClosureGraph`, which must be `args`.

    Converged: an undamped step was expected to lower the cost by less than `rtol * cost + atol`. A trial that is not
    finite, or raises the cost, is rejected and the damping raised; damping past 1e6 ends the solve as divergent.
    `max_steps` is a number here, where optimistix's is a constant of the program: it may change without a compilation.
    """

    rtol: Array | float = 1e-7
    atol: float = 1e-12
    max_steps: Array | int = 100
    tightest: Array | float = _TIGHTEST
    norm: Callable[[PyTree], Array] = eqx.field(static=True, default=optx.max_norm)

    def init(
        self, fn: Any, y: PyTree, args: ClosureGraph, options: dict, f_struct: Any, aux_struct: Any, tags: frozenset
    ) -> ClosureState:
        poses = args.base
        noise = closure_noise(poses, args.edges)
        zero, false, inf = jnp.zeros(()), jnp.array(False), jnp.array(jnp.inf)
        loosest = jnp.array(LOOSEST)
        return ClosureState(
            poses, noise, cost_of(noise, args), zero, loosest, inf, jnp.array(0), jnp.array(0), false, false
        )

    def step(
        self, fn: Any, y: PyTree, args: ClosureGraph, options: dict, state: ClosureState, tags: frozenset
    ) -> tuple[PyTree, ClosureState, Any]:
        slack = self.rtol * state.cost + self.atol
        increments, expected, cg_steps = closure_step(state, slack, args)
        poses = advance(state.poses, increments)
        noise = closure_noise(poses, args.edges)
        cost = cost_of(noise, args)
        accept = (cost <= state.cost) & jnp.isfinite(cost)
        undamped = state.damping == 0
        converged = undamped & jnp.isfinite(cost) & (expected <= slack)
        raised = jnp.maximum(state.damping * _DAMPING_FACTOR, _DAMPING_FIRST)
        lowered = jnp.where(state.damping <= _DAMPING_LOWEST, 0.0, state.damping / _DAMPING_FACTOR)
        poses, noise, cost = jax.tree.map(
            lambda new, old: jnp.where(accept, new, old), (poses, noise, cost), (state.poses, state.noise, state.cost)
        )
        damping = jnp.where(accept, lowered, raised)
        # The expected decrease is half the gradient's squared norm in the metric that the step is measured in.
        forcing = jnp.clip((expected / state.expected) ** _FORCING_POWER, self.tightest, LOOSEST)
        stuck = ~converged & ~accept & (damping > _DAMPING_HIGHEST)
        steps = (state.cg_steps + cg_steps, state.steps + 1)
        return y, ClosureState(poses, noise, cost, damping, forcing, expected, *steps, converged, stuck), None

    def terminate(
        self, fn: Any, y: PyTree, args: ClosureGraph, options: dict, state: ClosureState, tags: frozenset
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        late = ~state.converged & (state.steps >= self.max_steps)
        result = optx.RESULTS.where(late, optx.RESULTS.nonlinear_max_steps_reached, optx.RESULTS.successful)
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, result)
        return state.converged | state.stuck | late, result

    def postprocess(
        self,
        fn: Any,
        y: PyTree,
        aux: Any,
        args: ClosureGraph,
        options: dict,
        state: ClosureState,
        tags: frozenset,
        result: optx.RESULTS,
    ) -> tuple[PyTree, Any, dict[str, Any]]:
        back = soa.quat_conj(args.base.quat)
        turned = soa.quat_mul(state.poses.quat, back)
        return se3_soa.log(turned, soa.sub(state.poses.t, soa.rotate(turned, args.base.t))), aux, {}


def cost_of(noise: tuple[Vec3, Vec3], graph: ClosureGraph) -> Float[Array, ""]:
    """Half the sum of squared residuals."""
    return jnp.sum(edge_costs(squared_norms(noise, graph.edges), graph))


def closure_step(
    state: ClosureState, slack: Array, graph: ClosureGraph
) -> tuple[Float[Array, "6 n"], Float[Array, ""], Int[Array, ""]]:
    """World-frame increments of one damped Gauss-Newton step, the decrease that its model expects, and CG's steps.

    `slack` is the decrease that is not worth a step; a hundredth of it is not worth an iteration.
    """
    structure = graph.structure
    problem = condensed(state.poses, state.noise, state.damping, graph)
    force = on_joints(problem.force, structure.first, structure.second, structure.joint.shape[0])
    at_joints, cg_steps = solve_joints(problem.weight, force, structure, state.forcing, 0.01 * slack)
    expected = 0.5 * jnp.vdot(force, at_joints) + problem.settled
    return all_increments(at_joints, problem, graph), expected, cg_steps
