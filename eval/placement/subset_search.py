"""Choices from a list of candidates: every one, one after the other, or improved by exchange; no gradient needed."""

import itertools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from eval.placement.criteria import robust_criterion_m
from eval.placement.known_visits import KnownVisits
from eval.placement.predicted import posterior_of

# Choices judged side by side, and at a call: one shape for any number of them.
_BATCH, _CALL = 64, 1024
# A greedy choice begins with the best three of so few candidates that all their triples can be tried.
_TRIPLES = 5000
_MOST_ROUNDS = 10
# Where there are more choices than this, the best of so many random ones are improved by exchange.
EXHAUSTIVE, _RANDOM, _STARTS = 50_000, 4096, 8

# Rows of the candidates chosen, and the criterion.
Choice = tuple[Int[np.ndarray, "k"], float]


def best_subset(known: KnownVisits, count: int) -> Choice:
    """All C(n, count) choices tried."""
    best, value = np.arange(count), math.inf
    every = itertools.combinations(range(len(known)), count)
    while some := list(itertools.islice(every, 64 * _CALL)):
        choices = np.array(some)
        found = subset_values(known, choices)
        if found.min() < value:
            best, value = choices[int(np.argmin(found))], float(found.min())
    return best, value


def greedy_subset(known: KnownVisits, count: int) -> Choice:
    """The best three of the candidates (thinned until their triples are few), then one more at a time.

    With three markers standing already, one at a time from the first.
    """
    first = 1 if known.standing >= 3 else min(3, count)
    step = 1
    while math.comb(len(range(0, len(known), step)), first) > _TRIPLES:
        step += 1
    triples = np.array(list(itertools.combinations(range(0, len(known), step), first)))
    found = subset_values(known, triples)
    chosen, value = triples[int(np.argmin(found))], float(found.min())
    while len(chosen) < count:
        rest = np.setdiff1d(np.arange(len(known)), chosen)
        tried = np.column_stack([np.tile(chosen, (len(rest), 1)), rest])
        found = subset_values(known, tried)
        chosen, value = tried[int(np.argmin(found))], float(np.min(found))
    return chosen, value


def exchanged(known: KnownVisits, choice: Int[np.ndarray, "k"]) -> Choice:
    """One candidate after the other exchanged for the best, round after round, until none is better (Fedorov 1972)."""
    value = math.inf
    for _ in range(_MOST_ROUNDS):
        before = value
        for row in range(len(choice)):
            free = np.setdiff1d(np.arange(len(known)), np.delete(choice, row))
            tried = np.repeat(choice[None], len(free), axis=0)
            tried[:, row] = free
            found = subset_values(known, tried)
            choice, value = tried[int(np.argmin(found))], float(np.min(found))
        if not value < before:
            break
    return choice, value


def best_choice(known: KnownVisits, count: int, seed: int = 0) -> Choice:
    """All choices tried where they are few, else the best random ones improved by exchange; rows in their order."""
    if math.comb(len(known), count) <= EXHAUSTIVE:
        return best_subset(known, count)
    drawn = random_subsets(len(known), count, _RANDOM, np.random.default_rng(seed))
    starts = drawn[np.argsort(subset_values(known, drawn), kind="stable")[:_STARTS]]
    best, value = min((exchanged(known, start) for start in starts), key=lambda found: found[1])
    return np.sort(best), value


def random_subsets(n: int, count: int, draws: int, random: np.random.Generator) -> Int[np.ndarray, "s k"]:
    """Choices of `count` of n, each drawn without replacement."""
    return np.stack([random.choice(n, count, replace=False) for _ in range(draws)])


def subset_values(known: KnownVisits, choices: Int[np.ndarray, "s k"]) -> Float[np.ndarray, "s"]:
    """The criterion of each choice, with the standing markers; infinite where it is not a number."""
    call = _CALL if len(choices) > _BATCH else _BATCH
    rows = np.pad(choices, ((0, -len(choices) % call), (0, 0)), mode="edge").reshape(-1, call, choices.shape[1])
    value = np.concatenate([np.asarray(_subset_values(known, jnp.asarray(part))) for part in rows])
    return np.where(np.isfinite(value), value, np.inf)[: len(choices)]


@eqx.filter_jit
def _subset_values(known: KnownVisits, choices: Int[Array, "s k"]) -> Float[Array, "s"]:
    standing = len(known) + jnp.arange(known.standing)

    def one(choice: Int[Array, "k"]) -> Array:
        marker = jnp.concatenate([choice, standing])
        visit = (marker[:, None] * known.passes + jnp.arange(known.passes)[None]).reshape(-1)
        row = (visit[:, None] * 3 + jnp.arange(3)[None]).reshape(-1)
        found = posterior_of(
            jax.tree.map(lambda x: x[visit], known.visits),
            known.jacobian[visit],
            known.prior[:, row][:, :, row],
            known.cross[:, :, row],
            known.noise,
            known.watch,
            known.sight,
        )
        return robust_criterion_m(found, known.noise.weight, known.criterion, known.robust)

    return jax.lax.map(one, choices, batch_size=_BATCH)
