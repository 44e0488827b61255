"""Choices of candidates whose visits are known: as predicted for their visits alone, and the best of all choices."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from eval_.placement_problem import SIGHT, one_set, small_plan

import eval.placement.subset_search as module
from eval.placement.criteria import criterion_m
from eval.placement.known_visits import known_visits
from eval.placement.plan import position_at
from eval.placement.plan_visits import Visits
from eval.placement.predicted import covariance_given, watched
from eval.placement.subset_search import best_choice, subset_values

# Nine places round the loop; two of them are passed twice, and the path has them somewhere else the second time.
FIRST = np.array([4.0, 15.5, 31.0, 45.0, 60.0, 74.0, 88.0, 101.0, 120.0])
PLACE = [np.array([at]) for at in FIRST[:7]] + [np.array([101.0, 30.0]), np.array([120.0, 70.5])]


@pytest.fixture(scope="module")
def parts():
    plan, noise = small_plan(), one_set()
    watch = watched(plan, noise, 16)
    point = [np.asarray(position_at(plan, jnp.asarray(at))) + np.array([1.0, -2.0, 0.5]) for at in PLACE]
    return plan, noise, watch, point, known_visits(PLACE, point, plan, noise, watch, SIGHT)


def alone(choice, plan, noise, watch, point) -> float:
    """Of the visits of a choice, and of no others."""
    visits = Visits(
        jnp.asarray(np.concatenate([PLACE[i] for i in choice])),
        jnp.asarray(np.concatenate([point[i] for i in choice])),
        jnp.ones(sum(len(PLACE[i]) for i in choice)),
        jnp.asarray(np.concatenate([np.full(len(PLACE[i]), i) for i in choice])),
    )
    return float(criterion_m(_covariance(visits, plan, noise, watch, SIGHT)[0], "path"))


_covariance = eqx.filter_jit(covariance_given)


def test_a_choice_is_judged_by_all_its_visits_and_no_others(parts):
    *given, known = parts
    assert len(known) == 9
    choices = np.array([[0, 3, 7], [8, 2, 6], [1, 4, 8]])
    np.testing.assert_allclose(subset_values(known, choices), [alone(c, *given) for c in choices], rtol=1e-9)


def test_the_best_choice_is_the_best_of_all_and_exchange_finds_it(parts, monkeypatch):
    *_, known = parts
    every = np.array(list(itertools.combinations(range(9), 4)))
    value = subset_values(known, every)
    found, best = best_choice(known, 4)
    assert best == value.min()
    np.testing.assert_array_equal(found, every[np.argmin(value)])
    monkeypatch.setattr(module, "EXHAUSTIVE", 0)
    monkeypatch.setattr(module, "_RANDOM", 8)
    monkeypatch.setattr(module, "_STARTS", 2)
    exchanged, again = best_choice(known, 4)
    assert again == pytest.approx(best, rel=1e-12)
    np.testing.assert_array_equal(exchanged, found)


def test_markers_that_do_not_fix_the_frame_are_no_choice(parts):
    *_, known = parts
    assert subset_values(known, np.array([[3, 3, 3]]))[0] > 100.0 * subset_values(known, np.array([[0, 3, 6]]))[0]
