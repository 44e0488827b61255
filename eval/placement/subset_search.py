"""Layouts from a list of candidates: every choice, one after the other, or improved by exchange; no gradient needed."""

import itertools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from eval.placement.criteria import robust_criterion_m
from eval.placement.plan_drift import carried, covariance_of
from eval.placement.plan_visits import plan_visits
from eval.placement.predicted import posterior_of
from eval.placement.problem import Problem

# Subsets judged side by side, and at a call: one shape for any number of them.
_BATCH = 64
_CALL = 1024
# A greedy choice begins with the best three of so few candidates that all their triples can be tried.
_TRIPLES = 5000
_MOST_ROUNDS = 5


def best_subset(
    candidate_m: Float[np.ndarray, "c 3"], count: int, problem: Problem
) -> tuple[Int[np.ndarray, "k"], float]:
    """Try all C(c, k) subsets; rows of the best one, and its criterion."""
    best, value = np.arange(count), math.inf
    every = itertools.combinations(range(len(candidate_m)), count)
    while some := list(itertools.islice(every, 64 * _CALL)):
        subsets = np.array(some)
        found = subset_values(candidate_m, subsets, problem)
        if found.min() < value:
            best, value = subsets[int(np.argmin(found))], float(found.min())
    return best, value


def greedy_subset(
    candidate_m: Float[np.ndarray, "c 3"], count: int, problem: Problem
) -> tuple[Int[np.ndarray, "k"], float]:
    """The best three of the candidates (thinned until their triples are few), then one more at a time.

    With three markers standing already, one at a time from the first.
    """
    first = 1 if problem.standing_m.shape[0] >= 3 else min(3, count)
    step = 1
    while math.comb(len(candidate_m[::step]), first) > _TRIPLES:
        step += 1
    coarse = np.arange(0, len(candidate_m), step)
    rows, value = best_subset(candidate_m[coarse], first, problem)
    chosen = coarse[rows]
    while len(chosen) < count:
        rest = np.setdiff1d(np.arange(len(candidate_m)), chosen)
        tried = np.column_stack([np.tile(chosen, (len(rest), 1)), rest])
        found = subset_values(candidate_m, tried, problem)
        chosen, value = tried[int(np.argmin(found))], float(np.min(found))
    return chosen, value


def exchanged(
    subset: Int[np.ndarray, "k"], candidate_m: Float[np.ndarray, "c 3"], problem: Problem
) -> tuple[Int[np.ndarray, "k"], float]:
    """A subset improved by exchanging one marker at a time for the best candidate, round after round (Fedorov 1972)."""
    value = math.inf
    for _ in range(_MOST_ROUNDS):
        before = value
        for row in range(len(subset)):
            free = np.setdiff1d(np.arange(len(candidate_m)), np.delete(subset, row))
            tried = np.repeat(subset[None], len(free), axis=0)
            tried[:, row] = free
            found = subset_values(candidate_m, tried, problem)
            subset, value = tried[int(np.argmin(found))], float(np.min(found))
        if not value < before:
            break
    return subset, value


def subset_values(
    candidate_m: Float[np.ndarray, "c 3"], subsets: Int[np.ndarray, "s k"], problem: Problem
) -> Float[np.ndarray, "s"]:
    """The criterion of each subset of some candidates, with the standing markers; infinite where it is not a number."""
    call = _CALL if len(subsets) > _BATCH else _BATCH
    shared = _shared(jnp.asarray(candidate_m), problem)
    rows = np.pad(subsets, ((0, -len(subsets) % call), (0, 0)), mode="edge").reshape(-1, call, subsets.shape[1])
    value = np.concatenate([np.asarray(_subset_values(shared, jnp.asarray(part), problem)) for part in rows])
    return np.where(np.isfinite(value), value, np.inf)[: len(subsets)]


@eqx.filter_jit
def _shared(candidate_m: Float[Array, "c 3"], problem: Problem) -> tuple:
    """What subsets share: visits, their Jacobians, prior covariances; of the candidates, then the standing markers."""
    plan, noise = problem.plan, problem.noise
    every = jnp.concatenate([candidate_m, problem.standing_m])
    visits = plan_visits(every, plan, problem.sight, problem.passes)
    places = carried(plan, noise, visits.place, visits.point_m)
    prior = covariance_of(places, places, plan, noise)
    return visits, places.jacobian, prior, covariance_of(problem.watch.points, places, plan, noise)


@eqx.filter_jit
def _subset_values(shared: tuple, subsets: Int[Array, "s k"], problem: Problem) -> Float[Array, "s"]:
    visits, jacobian, prior, cross = shared
    passes, standing = problem.passes, problem.standing_m.shape[0]
    candidates = visits.place.shape[0] // passes - standing

    def one(subset: Int[Array, "k"]) -> Array:
        marker = jnp.concatenate([subset, candidates + jnp.arange(standing)])
        visit = (marker[:, None] * passes + jnp.arange(passes)[None]).reshape(-1)
        row = (visit[:, None] * 3 + jnp.arange(3)[None]).reshape(-1)
        own = jax.tree.map(lambda x: x[visit], visits)
        found = posterior_of(
            own,
            jacobian[visit],
            prior[:, row][:, :, row],
            cross[:, :, row],
            problem.noise,
            problem.watch,
            problem.sight,
        )
        return robust_criterion_m(found, problem.noise.weight, problem.criterion, problem.robust)

    return jax.lax.map(one, subsets, batch_size=_BATCH)
