"""Every way to the noise on one simulated session, side by side."""

import dataclasses

import numpy as np
import pytest

from benchmarks.noise_baselines import Problem, simulated_problem
from eval.loo import correct_and_hold_out
from eval.noise_baselines import NoiseBaseline, noise_baselines
from jaxgeo.graph.components import ensemble_of
from jaxgeo.simulate import UAV


@pytest.fixture(scope="module")
def problem() -> Problem:
    return simulated_problem(0, dataclasses.replace(UAV, n_poses=200))


@pytest.fixture(scope="module")
def rows(problem: Problem) -> dict[str, NoiseBaseline]:
    assert problem.true is not None
    given = problem.trajectory, problem.anchors, problem.settings, problem.learn
    found = noise_baselines(*given, transferred=ensemble_of(problem.true), true=problem.true)
    return {row.name: row for row in found}


def test_all_ways_are_there_and_none_failed(rows: dict[str, NoiseBaseline]):
    expected = ["similarity", "fixed", "scale factor", "bilevel", "transferred", "learned", "true"]
    assert list(rows) == expected
    for row in rows.values():
        assert row.n_failed == 0
        assert 0.0 < row.mean_m <= row.rms_m
        assert len(row.held_out.error_enh_m) == 7


def test_fixed_and_similarity_are_those_of_the_main_job(problem: Problem, rows: dict[str, NoiseBaseline]):
    _, fixed = correct_and_hold_out(problem.trajectory, problem.anchors, problem.learn.noise, problem.settings)
    np.testing.assert_array_equal(rows["fixed"].held_out.error_enh_m, fixed.refined.error_enh_m)
    np.testing.assert_array_equal(rows["similarity"].held_out.error_enh_m, fixed.coarse.error_enh_m)
    assert np.isnan(rows["similarity"].coverage_95)


def test_ways_that_see_the_session_cover_more_than_the_fixed_noise(rows: dict[str, NoiseBaseline]):
    """The simulated odometry drifts far more than the fixed noise says."""
    assert rows["fixed"].coverage_95 < 0.5
    for name in ("scale factor", "bilevel", "learned", "true"):
        assert rows[name].coverage_95 > rows["fixed"].coverage_95
        assert rows[name].mean_m < rows["similarity"].mean_m


def test_a_location_that_cannot_be_held_out_counts_as_failed(problem: Problem):
    """Three locations: none of the folds is determined."""
    anchors = problem.anchors
    keep = np.isin(anchors.location_index, [0, 1, 2])
    fields = {n: getattr(anchors, n) for n in vars(anchors)}
    few = type(anchors)(**{n: tuple(np.array(v)[keep]) if isinstance(v, tuple) else v[keep] for n, v in fields.items()})
    found = {
        row.name: row
        for row in noise_baselines(problem.trajectory, few, problem.settings, problem.learn, true=problem.true)
    }
    for name in ("fixed", "scale factor", "bilevel", "true"):
        assert found[name].n_failed == len(few)
        assert all(words.startswith("undetermined") for words in found[name].held_out.result)


def test_what_is_transferred_is_what_the_folds_are_solved_under(rows: dict[str, NoiseBaseline]):
    """Here the true noise was handed over as another session's."""
    np.testing.assert_array_equal(rows["transferred"].held_out.error_enh_m, rows["true"].held_out.error_enh_m)
    assert rows["true"].mean_m < rows["fixed"].mean_m
