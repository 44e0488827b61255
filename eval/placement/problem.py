"""What is known before a layout is chosen, and how accurate a layout makes the path."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from eval.placement.criteria import Criterion, Robust, robust_criterion_m
from eval.placement.plan import Plan
from eval.placement.plan_visits import Sight, plan_visits
from eval.placement.predicted import Watched, covariance_given
from eval.placement.region import Region
from jaxgeo.graph.components import NoiseEnsemble


class Problem(eqx.Module):
    """A path, its noise, and what is possible.

    Attributes:
        watch: points whose accuracy counts, of the same plan and noise.
        standing_m: (f, 3) markers that stand already, and are part of every layout.
        beside_m: how far from the path the watched points are, see `watched`.
        passes: of one marker that count, see `plan_visits`.
        criterion, robust: what is made small.
    """

    plan: Plan
    noise: NoiseEnsemble
    watch: Watched
    sight: Sight
    region: Region
    standing_m: Float[Array, "f 3"]
    beside_m: Float[Array, ""]
    passes: int = eqx.field(static=True)
    criterion: Criterion = eqx.field(static=True)
    robust: Robust = eqx.field(static=True)


def predicted_covariance(point_m: Float[Array, "k 3"], problem: Problem) -> Float[Array, "q m 3 3"]:
    """Posterior covariance of the watched points with markers at these points and at the standing ones."""
    every = jnp.concatenate([point_m, problem.standing_m])
    visits = plan_visits(every, problem.plan, problem.sight, problem.passes)
    return covariance_given(visits, problem.plan, problem.noise, problem.watch, problem.sight)


def accuracy_m(point_m: Float[Array, "k 3"], problem: Problem, *, smooth: bool = False) -> Float[Array, ""]:
    """The problem's criterion of a layout; `smooth`: to be searched by gradient."""
    found = predicted_covariance(point_m, problem)
    return robust_criterion_m(found, problem.noise.weight, problem.criterion, problem.robust, smooth=smooth)


@eqx.filter_jit
def accuracy(point_m: Float[Array, "k 3"], problem: Problem) -> Float[Array, ""]:
    """`accuracy_m`, compiled."""
    return accuracy_m(point_m, problem)


def without_standing(problem: Problem) -> Problem:
    """The same problem with no marker standing already: layouts then have all of theirs in them."""
    return eqx.tree_at(lambda p: p.standing_m, problem, jnp.zeros((0, 3)))
