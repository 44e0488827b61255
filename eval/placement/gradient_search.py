"""Layouts found by gradient, from many starts in one compiled call.

The criterion is minimised over the markers' places in plan, each moved to the nearest allowed place before it is
judged (projection), with optimistix's BFGS. The starts are equal spacing, the best of many random choices of places on
the path, some of them improved by exchange, and layouts with one marker at random on each equal stretch of it: places
that the path passes twice have narrow basins, to which no gradient points from afar.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from eval.placement.candidates import candidates_along, equal_spacing
from eval.placement.known_visits import candidate_visits
from eval.placement.plan import place_at_distance, position_at
from eval.placement.problem import Problem, accuracy_m
from eval.placement.region import placed
from eval.placement.subset_search import exchanged, random_subsets, subset_values
from jaxgeo.errors import InputError

# Plan coordinates are searched in units of this share of the path's extent.
_UNIT_SHARE = 0.1
_TOLERANCE = 1e-5
# Places along the path from which the random choices are drawn.
_ALONG = 48


@dataclasses.dataclass(frozen=True)
class SearchSettings:
    """`starts` layouts are improved for at most `steps` steps each.

    Half of them are the best of `subsets` random ones, of which the best `exchanged` are improved by exchange first.
    `batch` starts are worked on at a time.
    """

    starts: int = 64
    subsets: int = 2048
    exchanged: int = 2
    steps: int = 60
    batch: int = 16
    seed: int = 0


@dataclasses.dataclass(frozen=True)
class Found:
    """Layouts and their criterion, best first: point_m (s, k, 3), value_m (s,)."""

    point_m: Float[np.ndarray, "s k 3"]
    value_m: Float[np.ndarray, "s"]


def gradient_search(count: int, problem: Problem, settings: SearchSettings | None = None) -> Found:
    """Improve many layouts of `count` markers by their gradient.

    Raises:
        InputError: fewer than three markers, the standing ones with them: they cannot fix the frame.
    """
    settings = settings or SearchSettings()
    if count < 1 or count + problem.standing_m.shape[0] < 3:
        raise InputError(
            f"{count} markers and {problem.standing_m.shape[0]} that stand already cannot fix the frame; expected one "
            "or more, and three or more with those that stand."
        )
    starts = _starts(count, problem, settings)
    unit_m = _UNIT_SHARE * float(np.ptp(np.asarray(problem.plan.position_m)[:, :2], axis=0).max())
    point, value = _improved(jnp.asarray(starts), problem, unit_m, settings.steps, settings.batch)
    point, value = np.asarray(point), np.asarray(value)
    value = np.where(np.isfinite(value), value, np.inf)
    order = np.argsort(value, kind="stable")
    return Found(point[order], value[order])


@functools.partial(jax.jit, static_argnames=("steps", "batch"))
def _improved(
    starts: Float[Array, "s k 2"], problem: Problem, unit_m: float, steps: int, batch: int
) -> tuple[Float[Array, "s k 3"], Float[Array, "s"]]:
    def one(start: Float[Array, "k 2"]) -> tuple[Array, Array]:
        solver = optx.BFGS(_TOLERANCE, _TOLERANCE)
        found = optx.minimise(_cost, solver, start / unit_m, (problem, unit_m), max_steps=steps, throw=False)
        before, after = (placed(at, problem.plan, problem.region) for at in (start, unit_m * found.value))
        at_start, at_end = accuracy_m(before, problem), accuracy_m(after, problem)
        better = at_end < at_start  # false for NaN too
        return jnp.where(better, after, before), jnp.where(better, at_end, at_start)

    return jax.lax.map(one, starts, batch_size=batch)


def _cost(y: Float[Array, "k 2"], args: tuple[Problem, Array]) -> Float[Array, ""]:
    problem, unit_m = args
    return jnp.log(accuracy_m(placed(unit_m * y, problem.plan, problem.region), problem, smooth=True))


def _starts(count: int, problem: Problem, settings: SearchSettings) -> Float[np.ndarray, "s k 2"]:
    random = np.random.default_rng(settings.seed)
    candidates = candidates_along(problem, max(_ALONG, 2 * count))
    known = candidate_visits(candidates, problem)
    drawn = random_subsets(len(candidates), count, settings.subsets, random)
    best = np.argsort(subset_values(known, drawn), kind="stable")
    chosen = drawn[best[: settings.starts // 2]]
    for i in range(min(settings.exchanged, len(chosen))):
        chosen[i], _ = exchanged(known, chosen[i])
    rest = max(settings.starts - len(chosen) - 1, 0)
    share = (np.arange(count) + random.uniform(0.0, 1.0, (rest, count))) / count
    share = (share + random.uniform(0.0, 1.0, (rest, 1))) % 1.0
    plan = problem.plan
    at = position_at(plan, place_at_distance(plan, jnp.asarray(share.reshape(-1)) * plan.distance_m[-1]))
    aside = random.uniform(-1.0, 1.0, (rest, count, 2)) * float(problem.region.reach_m)
    stratified = np.asarray(at)[:, :2].reshape(rest, count, 2) + aside
    starts = [equal_spacing(count, problem)[None, :, :2], candidates[chosen][..., :2], stratified]
    return np.concatenate(starts)[: settings.starts]
