"""Candidates for markers with their visits, and what all choices of them share.

Either a plan's geometry says where the candidates are passed, or it is known, as of a session that has been driven: an
odometry that drifts comes by a place twice without knowing it, so passes cannot be told from its own shape.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from eval.placement.criteria import Criterion, Robust
from eval.placement.plan import Plan
from eval.placement.plan_drift import carried, covariance_of
from eval.placement.plan_visits import Sight, Visits, plan_visits
from eval.placement.predicted import Watched
from eval.placement.problem import Problem
from jaxgeo.graph.components import NoiseEnsemble


class KnownVisits(eqx.Module):
    """Candidates, and after them the markers that stand already and are part of every choice.

    Attributes:
        visits: `passes` rows of each, one candidate after the other; rows without a visit have `seen` 0.
        jacobian, prior, cross: of all rows, as `predicted.posterior_of` takes them.
    """

    visits: Visits
    jacobian: Float[Array, "v 3 6"]
    prior: Float[Array, "q x x"]
    cross: Float[Array, "q y x"]
    noise: NoiseEnsemble
    watch: Watched
    sight: Sight
    passes: int = eqx.field(static=True)
    standing: int = eqx.field(static=True)
    criterion: Criterion = eqx.field(static=True)
    robust: Robust = eqx.field(static=True)

    def __len__(self) -> int:
        return self.visits.place.shape[0] // self.passes - self.standing


def known_visits(
    place: Sequence[Float[np.ndarray, "_"]],
    point_m: Sequence[Float[np.ndarray, "_ 3"]],
    plan: Plan,
    noise: NoiseEnsemble,
    watch: Watched,
    sight: Sight,
    criterion: Criterion = "path",
    robust: Robust = "mixture",
) -> KnownVisits:
    """Gather candidates.

    Args:
        place: of every candidate, the places along the path at which it is visited.
        point_m: of every candidate, where it is, as the path has it at each of these visits.
    """
    passes = max(len(some) for some in place)
    rows = [np.minimum(np.arange(passes), len(some) - 1) for some in place]
    visits = Visits(
        jnp.asarray(np.concatenate([some[r] for some, r in zip(place, rows, strict=True)])),
        jnp.asarray(np.concatenate([some[r] for some, r in zip(point_m, rows, strict=True)])),
        jnp.asarray(np.concatenate([(np.arange(passes) < len(some)).astype(float) for some in place])),
        jnp.repeat(jnp.arange(len(place)), passes),
    )
    return KnownVisits(visits, *_shared(visits, plan, noise, watch), noise, watch, sight, passes, 0, criterion, robust)


def candidate_visits(candidate_m: Float[np.ndarray, "c 3"], problem: Problem) -> KnownVisits:
    """Candidates at some points, passed as the problem's plan passes them; with the problem's standing markers."""
    every = jnp.concatenate([jnp.asarray(candidate_m), problem.standing_m])
    visits = _passes(every, problem)
    return KnownVisits(
        visits,
        *_shared(visits, problem.plan, problem.noise, problem.watch),
        problem.noise,
        problem.watch,
        problem.sight,
        problem.passes,
        problem.standing_m.shape[0],
        problem.criterion,
        problem.robust,
    )


@eqx.filter_jit
def _passes(point_m: Float[Array, "c 3"], problem: Problem) -> Visits:
    return plan_visits(point_m, problem.plan, problem.sight, problem.passes)


@eqx.filter_jit
def _shared(visits: Visits, plan: Plan, noise: NoiseEnsemble, watch: Watched) -> tuple[Array, Array, Array]:
    places = carried(plan, noise, visits.place, visits.point_m)
    prior = covariance_of(places, places, plan, noise)
    return places.jacobian, prior, covariance_of(watch.points, places, plan, noise)
