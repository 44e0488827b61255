"""Choices of k locations: which there are, what fails, the sums, and that what is not used is not read.

On shapes that the leave-one-out tests have compiled.
"""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from eval_.small_problem import LEARN, LOCATIONS, NOISE, SETTINGS, SHIFT_M, problem, shifted, three_on_a_line
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2
from solve.chain_session import session

from calibration.learn import learn_folds
from eval.loo import correct_and_hold_out, correct_under_and_hold_out, learn_and_hold_out
from eval.similarity import _similarities, fitted_markers, markers_of
from eval.subsets import (
    SubsetErrors,
    ensemble_subsets,
    fixed_subsets,
    learned_subsets,
    location_subsets,
    pooled_summary,
    similarity_subsets,
    summary,
)
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import InputError
from jaxgeo.export.result import HeldOut
from jaxgeo.graph.components import ensemble_of
from jaxgeo.solve.ensemble_fold import solve_ensemble
from jaxgeo.solve.fold import solve_folds

ENSEMBLE = ensemble_of(NOISE)
WAYS = {
    "similarity": lambda t, a, ks: similarity_subsets(t, a, SETTINGS, ks),
    "fixed": lambda t, a, ks: fixed_subsets(t, a, NOISE, SETTINGS, ks),
    "ensemble": lambda t, a, ks: ensemble_subsets(t, a, SETTINGS, ENSEMBLE, ks),
    "learned": lambda t, a, ks: learned_subsets(t, a, SETTINGS, LEARN, ks),
}


@pytest.fixture(scope="module")
def made() -> tuple[Trajectory, Anchors]:
    return problem()


@pytest.fixture(scope="module")
def fixed(made):
    return correct_and_hold_out(*made, NOISE, SETTINGS)[1]


def rows_of(found: SubsetErrors) -> dict[tuple[int, ...], tuple[np.ndarray, ...]]:
    """{used locations: (in sample, held out, inside)}."""
    keys = [tuple(np.flatnonzero(used).tolist()) for used in found.used]
    return dict(zip(keys, zip(found.in_sample_m, found.held_out_m, found.inside_95, strict=True), strict=True))


@pytest.mark.parametrize(("n", "k"), [(6, 3), (6, 6), (5, 1), (9, 4)])
def test_all_choices_in_lexicographic_order(n, k):
    found = [tuple(np.flatnonzero(row)) for row in location_subsets(n, k)]
    assert found == list(itertools.combinations(range(n), k))


def test_where_there_are_too_many_some_are_drawn_without_repetition():
    found = location_subsets(20, 7, most=500, seed=1)
    assert found.shape == (500, 20)
    assert (found.sum(axis=1) == 7).all()
    assert len(np.unique(found, axis=0)) == 500
    # Every location as often as another: a share of 7/20, give or take four standard deviations.
    assert np.abs(found.mean(axis=0) - 0.35).max() < 4 * np.sqrt(0.35 * 0.65 / 500)
    assert_array_equal(found, location_subsets(20, 7, most=500, seed=1))
    assert (found != location_subsets(20, 7, most=500, seed=2)).any()
    assert len(np.unique(location_subsets(8, 4, most=69), axis=0)) == 69
    assert len(location_subsets(8, 4, most=70)) == math.comb(8, 4)


@pytest.mark.parametrize(("k", "most"), [(0, 5), (7, 5), (3, 0)])
def test_choices_that_there_are_none_of(k, most):
    with pytest.raises(InputError, match=f"choices of {k} of 6 locations"):
        location_subsets(6, k, most)


def test_all_but_one_is_leave_one_out_and_compiles_nothing_more(made, fixed):
    trajectory, anchors = made
    _, _, learned = learn_and_hold_out(trajectory, anchors, SETTINGS, LEARN, fixed)
    _, under = correct_under_and_hold_out(trajectory, anchors, SETTINGS, ENSEMBLE, fixed)
    expected: dict[str, HeldOut] = {
        "similarity": fixed.coarse,
        "fixed": fixed.refined,
        "learned": learned.refined,
        "ensemble": under.refined,
    }
    compiled = [program._cache_size() for program in (solve_folds, learn_folds, solve_ensemble)]
    for way, held_out in expected.items():
        (found,) = WAYS[way](trajectory, anchors, [5])
        norm_m = np.linalg.norm(held_out.error_enh_m, axis=1)
        assert (norm_m > 0.01).all()
        for used, held_out_m, inside in zip(found.used, found.held_out_m, found.inside_95, strict=True):
            (location,) = np.flatnonzero(~used)
            here = anchors.location_index == location
            assert_allclose(held_out_m[here], norm_m[here], rtol=0, atol=1e-9 if way == "similarity" else 0)
            assert np.isnan(held_out_m[~here]).all()
            e, p = held_out.error_enh_m[here], held_out.covariance_m2[here]
            nees = np.array(
                [a @ np.linalg.inv(b) @ a if np.isfinite(b).all() else np.nan for a, b in zip(e, p, strict=True)]
            )
            assert_array_equal(inside[here], np.where(np.isnan(nees), np.nan, nees <= chi2.ppf(0.95, 3)))
    assert [program._cache_size() for program in (solve_folds, learn_folds, solve_ensemble)] == compiled


@pytest.mark.parametrize("way", WAYS)
def test_what_is_not_used_reaches_nothing_to_the_last_bit(made, way):
    trajectory, anchors = made
    moved = shifted(anchors, "D")
    # Five: as few as show it, where each takes long.
    k = 5 if way == "learned" else 4
    (here,), (there,) = (WAYS[way](trajectory, a, [k]) for a in (anchors, moved))
    of_d = np.array([name == "D" for name in anchors.location])
    without, witness = 0, 0
    for used, a, b in zip(here.used, rows_of(here).values(), rows_of(there).values(), strict=True):
        if used[LOCATIONS.index("D")]:
            witness += not np.array_equal(a[0], b[0], equal_nan=True)
            continue
        without += 1
        for x, y in zip(a, b, strict=True):
            assert_array_equal(x[~of_d], y[~of_d])
        # The prediction of D stayed: its error is what the shift makes of it, so no longer nor shorter than that.
        assert abs(b[1][of_d] - np.linalg.norm(SHIFT_M)) <= a[1][of_d]
    assert (without, witness) == (math.comb(5, k), math.comb(5, k - 1))


def test_the_error_of_what_is_held_out_differs_by_the_shift_alone(made, fixed):
    trajectory, anchors = made
    (row,) = np.flatnonzero([name == "D" for name in anchors.location])
    (found,) = fixed_subsets(trajectory, shifted(anchors, "D"), NOISE, SETTINGS, [5])
    used = tuple(i for i in range(6) if LOCATIONS[i] != "D")
    expected = np.linalg.norm(fixed.refined.error_enh_m[row] - SHIFT_M)
    assert_allclose(rows_of(found)[used][1][row], expected, rtol=1e-14)


@pytest.mark.parametrize("way", WAYS)
def test_choices_on_one_line_are_failed_and_counted(way):
    trajectory, anchors = three_on_a_line()
    if way == "learned":
        (found,) = learned_of_few(trajectory, anchors)
    else:
        more, found = WAYS[way](trajectory, anchors, [4, 3])
        assert not more.failed.any()
    failed = [tuple(np.flatnonzero(used).tolist()) for used in found.used[found.failed]]
    line = tuple(LOCATIONS.index(name) for name in "BCD")
    assert failed == [line]
    for values in rows_of(found)[line]:
        assert np.isnan(values).all()
    assert (np.isfinite(found.in_sample_m).any(axis=1) == ~found.failed).all()
    total = summary(found)
    assert (total.n_subsets, total.n_possible, total.n_failed) == (len(found.used), 20, 1)


def learned_of_few(trajectory: Trajectory, anchors: Anchors) -> tuple[SubsetErrors, ...]:
    """A sample of the choices that holds the one on the line: learning from all of them takes long."""
    for seed in itertools.count():
        if any(row[1] and row[2] and row[3] for row in location_subsets(6, 3, 6, seed)):
            return learned_subsets(trajectory, anchors, SETTINGS, LEARN, [3], most=6, seed=seed)
    raise AssertionError


def test_the_frame_is_judged_as_in_the_folds(made):
    """Anchors worse and worse known, until they fix no frame: similarity and graph refuse the same choices."""
    trajectory, anchors = made
    refused = 0
    for sigma_m in (1.0, 4.0, 8.0):
        vague = dataclasses.replace(anchors, survey_covariance_m2=np.tile(sigma_m**2 * np.eye(3), (7, 1, 1)))
        (similarity,), (graph,) = (WAYS[way](trajectory, vague, [3]) for way in ("similarity", "fixed"))
        assert_array_equal(similarity.failed, graph.failed)
        refused += int(graph.failed.sum())
    assert 0 < refused < 60


def test_gravity_and_surveyed_rotations_help_only_where_they_are_used():
    made = session(100, 7, lever_m=1.0, sigma_rot_rad=0.02)
    anchors = dataclasses.replace(made.anchors, surveyed_enh_m=made.anchors.surveyed_enh_m * [1.0, 0.0, 0.0])
    rows = np.ones((1, 7))

    def fixes(*, gravity: bool, rotations: bool, of_graph: bool) -> bool:
        markers = markers_of(made.trajectory, anchors, 0.0, rotations=rotations)
        return bool(fitted_markers(markers, rows, scale=True, gravity=gravity, of_graph=of_graph)[1][0])

    assert not fixes(gravity=False, rotations=False, of_graph=False)
    assert fixes(gravity=True, rotations=False, of_graph=False)
    assert not fixes(gravity=True, rotations=False, of_graph=True)
    assert fixes(gravity=False, rotations=True, of_graph=True)


def test_only_first_visits_take_part_where_asked(made):
    trajectory, anchors = made
    first, every = (similarity_subsets(trajectory, anchors, SETTINGS, visits=v) for v in ("first", "all"))
    assert [each.k for each in first] == [6, 5, 4, 3]
    again = 6  # the second visit of A
    for one, both in zip(first, every, strict=True):
        assert np.isnan(one.in_sample_m[:, again]).all()
        assert np.isnan(one.held_out_m[:, again]).all()
        assert_array_equal(np.isfinite(one.in_sample_m[:, :6]), one.used)
        assert_array_equal(np.isfinite(one.held_out_m[:, :6]), ~one.used)
        assert_array_equal(np.isfinite(both.in_sample_m), both.used[:, anchors.location_index])
        # Choices without A do not know of its second visit.
        assert_allclose(one.in_sample_m[~one.used[:, 0]], both.in_sample_m[~one.used[:, 0]], rtol=1e-12)
        with_a = one.used[:, 0]
        assert np.abs(one.in_sample_m[with_a, :6] - both.in_sample_m[with_a, :6])[one.used[with_a]].min() > 0


def test_sums_of_several_sessions_are_over_all_their_visits():
    def errors(used: list[list[int]], in_sample, held_out, inside, failed) -> SubsetErrors:
        return SubsetErrors(2, 5, np.array(used, bool), *map(np.array, (in_sample, held_out, inside, failed)))

    nan = np.nan
    a = errors([[1, 1, 0], [1, 0, 1]], [[1.0, 3.0, nan], [nan] * 3], [[nan, nan, 6.0], [nan] * 3],
               [[nan, nan, 0.0], [nan] * 3], [False, True])  # fmt: skip
    b = errors([[0, 1, 1]], [[nan, 5.0, 7.0]], [[2.0, nan, nan]], [[1.0, nan, nan]], [False])
    total = pooled_summary([a, b])
    assert (total.k, total.n_subsets, total.n_failed, total.n_possible) == (2, 3, 1, 10)
    assert (total.in_sample_mean_m, total.held_out_mean_m, total.coverage_95) == (4.0, 4.0, 0.5)
    assert (total.in_sample_rms_m, total.held_out_rms_m) == (np.sqrt(21.0), np.sqrt(20.0))
    assert summary(a).held_out_mean_m == 6.0
    with pytest.raises(InputError, match=r"k = \[2, 3\]"):
        pooled_summary([a, dataclasses.replace(b, k=3)])


def test_all_anchors_leave_nothing_to_hold_out(made):
    trajectory, anchors = made
    (found,) = WAYS["fixed"](trajectory, anchors, [6])
    total = summary(found)
    assert (total.k, total.n_subsets) == (6, 1)
    assert np.isnan([total.held_out_mean_m, total.held_out_rms_m, total.coverage_95]).all()
    assert 0.0 < total.in_sample_mean_m <= total.in_sample_rms_m < 1.0


def test_the_similarity_of_many_sessions_is_one_program(made):
    """It sees markers only, so that a session of another length runs what is compiled."""
    trajectory, anchors = made
    similarity_subsets(trajectory, anchors, SETTINGS)
    compiled = _similarities._cache_size()
    other = session(300, 7, location=LOCATIONS)
    similarity_subsets(other.trajectory, other.anchors, SETTINGS)
    assert _similarities._cache_size() == compiled
