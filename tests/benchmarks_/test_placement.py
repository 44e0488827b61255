"""The pieces of the placement benchmark on tiny data; no figure of it is judged here."""

import numpy as np
import pytest

from benchmarks.placement import headline
from benchmarks.placement_paths import candidate_visits, way_m
from benchmarks.placement_real import MEASURES, against, random_choices, random_summary, rank_correlation
from benchmarks.placement_shapes import SHAPES, differences, shape_path
from benchmarks.placement_simulated import CURVE, rms, summary


def test_candidates_are_passed_wherever_the_path_comes_by():
    # There and back on two lines 3 m apart: every place is passed twice, but where the turn is nearer than 50 m of way.
    along = np.linspace(0.0, 200.0, 201)
    there, back = np.column_stack([along, 0.0 * along]), np.column_stack([along[::-1], 0.0 * along + 3.0])
    path = np.column_stack([np.concatenate([there, back]), np.zeros(402)])
    assert way_m(path)[-1] == pytest.approx(403.0)
    visits = candidate_visits(path, 5)
    assert [len(rows) for rows in visits] == [2, 2, 1, 2, 2]
    for rows in visits:
        assert np.all(np.diff(rows) > 0)
        assert np.ptp(path[rows, 0]) <= 2.0


def test_failed_choices_are_the_worst_and_a_share_is_of_all():
    random = np.array([[1.0, 2.0, np.nan], [3.0, 4.0, np.nan], [np.inf, np.inf, np.nan], [2.0, 3.0, np.nan]])
    found = against(np.array([2.5, 3.0, np.nan]), random)
    assert found["held_out_mean_m"] == 2.5
    assert found["held_out_mean_m_beats_random"] == 0.5
    assert found["held_out_rms_m_beats_random"] == 0.5  # not the one that is as good
    assert found["path_rmse_m"] is None
    assert found["path_rmse_m_beats_random"] is None
    table = random_summary(np.array([0.5, 1.5, 4.0, 1.0]), random)
    assert set(table) == {"choices", *MEASURES[:2]}
    assert table["held_out_mean_m"] == {
        "lower_quartile": 2.0,
        "median": 3.0,
        "upper_quartile": None,
        "least": 1.0,
        "rank_correlation_with_promise": pytest.approx(1.0),
        "log_scatter_about_promise": pytest.approx(0.0),
    }
    assert rank_correlation(np.arange(4.0), np.ones(4)) is None


def test_random_choices_repeat_no_candidate_and_are_the_same_for_a_seed():
    drawn = random_choices(9, 4, 50, 1)
    assert all(len(set(row)) == 4 for row in drawn)
    np.testing.assert_array_equal(drawn, random_choices(9, 4, 50, 1))
    assert (drawn != random_choices(9, 4, 50, 2)).any()


def test_promised_over_achieved_leaves_out_what_failed_and_says_so():
    table = np.empty((4, 3, 20))
    table[:, 0], table[:, 1], table[:, 2] = 4.0, 1.0, 16.0
    table[3, 1] = np.nan
    table[3, 0] = 400.0
    found = summary(table)
    assert found["true_noise"]["predicted_over_achieved"] == pytest.approx(2.0)
    assert found["true_noise"]["failed"] == 1
    assert found["true_noise"]["interval_95"] == pytest.approx([2.0, 2.0])
    assert found["learned_noise"]["failed"] == 0
    assert found["learned_noise"]["achieved_rms_m"] == pytest.approx(4.0)
    assert len(found["curve_promised_m"]) == CURVE
    assert rms(np.array([9.0, 16.0])) == pytest.approx(12.5**0.5)


def test_shapes_are_driven_nose_first():
    for shape in SHAPES:
        path = shape_path(shape, 200)
        heading = 2.0 * np.arctan2(path.quat_wxyz[:, 3], path.quat_wxyz[:, 0])
        step = np.diff(path.position_m, axis=0)[:, :2]
        ahead = np.column_stack([np.cos(heading), np.sin(heading)])[:-1]
        cosine = np.sum(step * ahead, axis=1) / np.linalg.norm(step, axis=1)
        assert cosine.min() > 0.99, shape


def test_headline_of_parts_not_asked_for_is_empty():
    parts = dict.fromkeys(("simulated", "shapes", "real", "speed"))
    assert set(headline(parts).values()) == {None}
    parts["shapes"] = {"gap_to_exhaustive": -0.01}
    parts["speed"] = [{"warm_s": 12.0}, {"warm_s": 24.0}]
    assert headline(parts) == {"predicted_over_achieved": None, "gap_to_exhaustive": -0.01, "seconds_64_starts": 12.0}


def test_central_differences_are_of_the_criterion(monkeypatch):
    def value(point_m, problem):
        return (point_m[0, 0] ** 3 + problem * point_m[1, 2]) * 1.0

    monkeypatch.setattr("benchmarks.placement_shapes.accuracy", value)
    found = differences(np.array([[2.0, 5.0, 1.0], [1.0, 1.0, 1.0]]), 7.0)
    np.testing.assert_allclose(found, [[12.0, 0.0, 0.0], [0.0, 0.0, 7.0]], atol=1e-6)
