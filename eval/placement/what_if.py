"""What would change the accuracy of a layout: a marker more or fewer, a way back, better measuring; and by how much."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from eval.placement.answer import Sensitivity, WhatIf
from eval.placement.candidates import candidates_along
from eval.placement.criteria import robust_criterion_m
from eval.placement.known_visits import candidate_visits
from eval.placement.plan import extended_plan
from eval.placement.plan_visits import Visits, plan_visits
from eval.placement.predicted import UNDETERMINED_M, covariance_given, watched
from eval.placement.problem import Problem, accuracy, accuracy_m, without_standing
from eval.placement.subset_search import subset_values
from jaxgeo.data import Trajectory
from jaxgeo.graph.components import COMPONENTS

# Places along the path at which one more marker is tried.
_ALONG = 48
# A better survey has half the standard deviation; twice the dwell halves the variance of what averages out.
BETTER_SURVEY, LONGER_DWELL = 0.5, 2.0


class _Change(eqx.Module):
    """Factors of e on standard deviations, and shifts of the markers in plan; no change is zero."""

    survey: Float[Array, ""]
    sighting: Float[Array, ""]
    noise: Float[Array, "n"]
    shift_m: Float[Array, "k 2"]


def what_if(
    path: Trajectory,
    point_m: Float[np.ndarray, "k 3"],
    name: tuple[str, ...],
    standing: tuple[bool, ...],
    problem: Problem,
    candidate_m: Float[np.ndarray, "c 3"] | None = None,
    floor_m: float = 0.0,
) -> tuple[WhatIf, ...]:
    """Every single change of a layout, worked out anew.

    Args:
        path: that the problem's plan is of.
        point_m, name, standing: all markers, the standing ones too.
        problem: its own standing markers are not read.
        candidate_m: where one more marker may stand; None: anywhere allowed along the path.
        floor_m: of a visit's standard deviation, what no dwell averages out.
    """
    free = without_standing(problem)
    found = [_one_more(point_m, problem, candidate_m)]
    found += [_one_lost(point_m, name, i, free) for i in range(len(name)) if not standing[i]]
    found += [_revisit(path, point_m, name, i, free) for i in range(len(name))]
    better = eqx.tree_at(lambda p: p.sight.survey_sigma_m, free, BETTER_SURVEY * free.sight.survey_sigma_m)
    averaged = (free.sight.sigma_m**2 - floor_m**2) / LONGER_DWELL
    longer = eqx.tree_at(lambda p: p.sight.sigma_m, free, jnp.sqrt(floor_m**2 + averaged))
    points = jnp.asarray(point_m)
    found.append(WhatIf("better survey", "", None, 0.0, _finite(accuracy(points, better))))
    found.append(WhatIf("longer dwell", "", None, 0.0, _finite(accuracy(points, longer))))
    return tuple(found)


def sensitivity(point_m: Float[np.ndarray, "k 3"], problem: Problem) -> Sensitivity:
    """Derivatives of the logarithm of a layout's criterion; `point_m` all markers."""
    free = without_standing(problem)
    gradient = _gradient(jnp.asarray(point_m), free)
    present = np.asarray(problem.noise.weight @ problem.noise.sigma) > 0.0
    noise = dict(zip(COMPONENTS, np.asarray(gradient.noise).tolist(), strict=True))
    return Sensitivity(
        survey_sigma=float(gradient.survey),
        sighting_sigma=float(gradient.sighting),
        noise={c: value for (c, value), there in zip(noise.items(), present, strict=True) if there},
        position_per_m=np.asarray(gradient.shift_m),
    )


@eqx.filter_jit
def _gradient(point_m: Float[Array, "k 3"], problem: Problem) -> _Change:
    def changed(change: _Change) -> Float[Array, ""]:
        sigma = problem.noise.sigma * jnp.exp(change.noise)[None]
        noise = eqx.tree_at(lambda n: n.sigma, problem.noise, sigma)
        sight = eqx.tree_at(
            lambda s: (s.survey_sigma_m, s.sigma_m),
            problem.sight,
            (problem.sight.survey_sigma_m * jnp.exp(change.survey), problem.sight.sigma_m * jnp.exp(change.sighting)),
        )
        watch = watched(problem.plan, noise, problem.watch.points.place.shape[0], beside_m=problem.beside_m)
        other = eqx.tree_at(lambda p: (p.noise, p.sight, p.watch), problem, (noise, sight, watch))
        moved = point_m + jnp.pad(change.shift_m, ((0, 0), (0, 1)))
        return jnp.log(accuracy_m(moved, other, smooth=True))

    none = _Change(jnp.zeros(()), jnp.zeros(()), jnp.zeros(len(COMPONENTS)), jnp.zeros((point_m.shape[0], 2)))
    return jax.grad(changed)(none)


def _one_more(
    point_m: Float[np.ndarray, "k 3"], problem: Problem, candidate_m: Float[np.ndarray, "c 3"] | None
) -> WhatIf:
    with_all = eqx.tree_at(lambda p: p.standing_m, problem, jnp.asarray(point_m))
    tried = candidates_along(problem, _ALONG) if candidate_m is None else candidate_m
    value = subset_values(candidate_visits(tried, with_all), np.arange(len(tried))[:, None])
    best = int(np.argmin(value))
    return WhatIf("one more", "", tried[best], 0.0, float(value[best]))


def _one_lost(point_m: Float[np.ndarray, "k 3"], name: tuple[str, ...], lost: int, free: Problem) -> WhatIf:
    left = jnp.asarray(np.delete(point_m, lost, axis=0))
    value = _finite(accuracy(left, free)) if len(left) >= 3 else float("inf")
    return WhatIf("one lost", name[lost], None, 0.0, value)


def _revisit(
    path: Trajectory, point_m: Float[np.ndarray, "k 3"], name: tuple[str, ...], again: int, free: Problem
) -> WhatIf:
    """Straight on from the path's end to a marker, to see it once more; the accuracy is still that of the path."""
    longer = extended_plan(path, point_m[again], free.plan)
    further_m = float(np.linalg.norm(point_m[again] - np.asarray(free.plan.position_m[-1])))
    value = _after_revisit(jnp.asarray(point_m), jnp.asarray(again), longer, free)
    return WhatIf("revisit", name[again], None, further_m, _finite(value))


@eqx.filter_jit
def _after_revisit(point_m: Float[Array, "k 3"], again: Array, longer, problem: Problem) -> Float[Array, ""]:
    seen = plan_visits(point_m, problem.plan, problem.sight, problem.passes)
    visits = Visits(
        jnp.append(seen.place, len(longer) - 1.0),
        jnp.concatenate([seen.point_m, point_m[again][None]]),
        jnp.append(seen.seen, 1.0),
        jnp.append(seen.location, again),
    )
    noise = problem.noise
    count = problem.watch.points.place.shape[0]
    watch = watched(longer, noise, count, upto=len(problem.plan) - 1.0, beside_m=problem.beside_m)
    found = covariance_given(visits, longer, noise, watch, problem.sight)
    return robust_criterion_m(found, noise.weight, problem.criterion, problem.robust)


def _finite(value: Array) -> float:
    """Infinite where the frame is not fixed."""
    number = float(value)
    return number if number < UNDETERMINED_M else float("inf")
