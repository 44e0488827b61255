"""The stages that are timed, and that each time is of what it says."""

import time

import jax.numpy as jnp
import numpy as np
import pytest
from eval_.small_problem import LEARN, NOISE, SETTINGS, problem
from numpy.testing import assert_allclose

import eval.cost
from calibration.learn import learn_folds
from eval.cost import times_s, trajectory_cost
from eval.subsets import fixed_subsets, learned_subsets
from jaxgeo.solve.fold import solve_folds

FIXED = ["coarse fit", "correction", "solve", "hold out, fixed noise"]
LEARNED = ["learn the noise", "hold out, learned noise"]


def test_every_stage_by_the_programs_that_choices_of_anchors_run():
    trajectory, anchors = problem()
    fixed_subsets(trajectory, anchors, NOISE, SETTINGS, [5])
    learned_subsets(trajectory, anchors, SETTINGS, LEARN, [5])
    compiled = solve_folds._cache_size(), learn_folds._cache_size()
    rows = trajectory_cost(trajectory, anchors, NOISE, SETTINGS, LEARN, repetitions=1)
    assert (solve_folds._cache_size(), learn_folds._cache_size()) == compiled
    seconds = {row.stage: row.seconds for row in rows}
    assert list(seconds) == FIXED + LEARNED
    assert seconds["learn the noise"] > 2.0 * seconds["solve"] > 0.0
    assert seconds["hold out, learned noise"] > 2.0 * seconds["hold out, fixed noise"]
    assert [row.stage for row in trajectory_cost(trajectory, anchors, NOISE, SETTINGS, None, 1)] == FIXED


def test_shares_of_a_call_by_times_that_are_known(monkeypatch):
    """Of 8 rows in a call: the solve takes 10 ms a row, the folds 20; learning ten times that; 3 ms are the rest."""
    one, fold, rest = 0.010, 0.020, 0.003

    def times(repetitions, *functions):
        assert len(functions) == 6
        whole, folds = 8 * one, 6 * fold + 2 * one
        return np.array([[0.001, folds + rest, whole, folds, 10 * whole, 10 * folds]] * repetitions)

    monkeypatch.setattr(eval.cost, "times_s", times)
    seconds = {row.stage: row.seconds for row in trajectory_cost(*problem(), NOISE, SETTINGS, LEARN)}
    expected = [0.001, one + rest, one, 6 * fold, 10 * one, 60 * fold]
    assert_allclose([seconds[stage] for stage in FIXED + LEARNED], expected, rtol=1e-9)


def test_times_are_warm_and_in_turn():
    calls = []

    def slow_at_first():
        calls.append("a")
        time.sleep(0.2 if len(calls) == 1 else 0.01)
        return jnp.zeros(3)

    def fast():
        calls.append("b")

    found = times_s(3, slow_at_first, fast)
    assert "".join(calls) == "ab" + 3 * "ab"
    assert found.shape == (3, 2)
    assert found[:, 0].max() < 0.15
    assert np.median(found[:, 0]) == pytest.approx(0.01, rel=0.9)
