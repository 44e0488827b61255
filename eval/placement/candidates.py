"""Places along a path from which layouts are chosen, and equal spacing: what every layout is compared with."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from eval.placement.plan import Plan, place_at_distance, position_at
from eval.placement.plan_visits import plan_visits
from eval.placement.problem import Problem
from eval.placement.region import placed

# A path whose ends lie nearer together than this share of its length is closed.
CLOSED = 0.02
# Places along and beside the path at which passes are counted.
_GRID, _ASIDE = 256, 5

placed_all = jax.jit(placed)


def along_path(problem: Problem, share: Float[np.ndarray, "c"]) -> Float[np.ndarray, "c 3"]:
    """The nearest allowed places at some shares (0 .. 1) of the way."""
    plan = problem.plan
    at = position_at(plan, place_at_distance(plan, jnp.asarray(share) * plan.distance_m[-1]))
    return np.asarray(placed_all(at[:, :2], plan, problem.region))


def equal_spacing(count: int, problem: Problem, first: float = 0.0) -> Float[np.ndarray, "k 3"]:
    """Markers at equal distances along the path: both its ends and evenly between; round a closed one from `first`."""
    if is_closed(problem.plan):
        return along_path(problem, (np.arange(count) / count + first) % 1.0)
    return along_path(problem, np.linspace(0.0, 1.0, count))


def candidates_along(problem: Problem, along: int, aside: int = 1) -> Float[np.ndarray, "c 3"]:
    """A grid of places: `along` the path, and `aside` of it from -reach to +reach (1: on the path itself)."""
    plan = problem.plan
    share = np.linspace(0.0, 1.0, along, endpoint=not is_closed(plan))
    if aside == 1:
        return along_path(problem, share)
    way = share * float(plan.distance_m[-1])
    position, distance = np.asarray(plan.position_m)[:, :2], np.asarray(plan.distance_m)
    at = np.column_stack([np.interp(way, distance, axis) for axis in position.T])
    half = 0.5 * distance[-1] / along
    ahead = np.column_stack(
        [np.interp(way + half, distance, axis) - np.interp(way - half, distance, axis) for axis in position.T]
    )
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    offset = float(problem.region.reach_m) * np.linspace(-1.0, 1.0, aside)
    every = at[:, None] + offset[None, :, None] * left[:, None]
    return np.asarray(placed_all(jnp.asarray(every.reshape(-1, 2)), plan, problem.region))


def most_passes(problem: Problem) -> int:
    """Passes from which any marker of a grid beside the path is seen, at most `problem.passes`: no more are needed."""
    grid = candidates_along(problem, _GRID, _ASIDE)
    seen = _seen(jnp.asarray(grid), problem).reshape(len(grid), problem.passes)
    return max(int(np.max(np.sum(np.asarray(seen) > 0.0, axis=1))), 1)


@eqx.filter_jit
def _seen(point_m: Float[Array, "c 3"], problem: Problem) -> Float[Array, "v"]:
    return plan_visits(point_m, problem.plan, problem.sight, problem.passes).seen


def is_closed(plan: Plan) -> bool:
    """Whether the path comes back to its start."""
    ends = np.asarray(plan.position_m)[[0, -1]]
    return bool(np.linalg.norm(ends[1] - ends[0]) < CLOSED * float(plan.distance_m[-1]))
