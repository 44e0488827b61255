"""Choices of anchors corrected alone: as `calibrate_and_correct` does it with nothing else, and judged by the rest."""

import dataclasses

import numpy as np
import pytest
from eval_.small_problem import LEARN, SETTINGS, SHIFT_M, problem, shifted, three_on_a_line

from calibration.calibrate import calibrate_and_correct
from eval.placement.scored import corrected_with, marker_error_m, of_locations

CHOICE = np.array([True, False, True, True, True, False])  # A C D E


@pytest.fixture(scope="module")
def session():
    return problem()


def chosen(trajectory, anchors, *choices):
    return list(corrected_with(trajectory, anchors, np.array(choices), SETTINGS, LEARN))


def test_a_choice_is_corrected_by_its_visits_alone(session):
    trajectory, anchors = session
    # A choice of more visits makes the common table larger than this one needs.
    found = chosen(trajectory, anchors, CHOICE, np.ones(6, dtype=bool))[0]
    assert found.determined
    own = of_locations(anchors, CHOICE)
    _, correction, _ = calibrate_and_correct(trajectory, own, SETTINGS, LEARN, np.zeros((0, len(own))))
    np.testing.assert_allclose(found.corrected.position_m, correction.corrected.position_m, atol=1e-6)
    # Nothing of what was left out is read.
    moved = chosen(trajectory, shifted(anchors, "B"), CHOICE)[0]
    np.testing.assert_array_equal(moved.corrected.position_m, found.corrected.position_m)
    error = marker_error_m(found.corrected, anchors)
    apart = marker_error_m(moved.corrected, shifted(anchors, "B")) - error
    assert abs(apart[1]) > 0.5 * np.linalg.norm(SHIFT_M)
    assert np.all(apart[[0, 2, 3, 4, 5, 6]] == 0.0)


def test_a_choice_on_a_line_has_no_path():
    trajectory, anchors = three_on_a_line()
    line = np.array([False, True, True, True, False, False])
    assert [each.determined for each in chosen(trajectory, anchors, line, CHOICE)] == [False, True]
    assert chosen(trajectory, anchors, line)[0].corrected is None


def test_locations_that_are_left_are_numbered_by_their_first_visit(session):
    _, anchors = session
    own = of_locations(anchors, CHOICE)
    assert own.location == ("A", "C", "D", "E", "A")
    np.testing.assert_array_equal(own.location_index, [0, 1, 2, 3, 0])
    np.testing.assert_array_equal(own.surveyed_enh_m, anchors.surveyed_enh_m[[0, 2, 3, 4, 6]])
    # Out of order too: the location that is seen first is the first.
    swapped = dataclasses.replace(anchors, location_index=np.array([5, 1, 2, 3, 4, 0, 5]))
    kept = of_locations(swapped, np.array([True, False, True, False, False, True]))
    np.testing.assert_array_equal(kept.location_index, [0, 1, 2, 0])


def test_a_perfect_path_has_its_markers_where_they_were_surveyed(session):
    trajectory, anchors = session
    found = chosen(trajectory, anchors, np.ones(6, dtype=bool))[0].corrected
    assert marker_error_m(found, anchors).max() < 0.5
    off = dataclasses.replace(found, position_m=found.position_m + np.array([3.0, 0.0, 4.0]))
    np.testing.assert_allclose(marker_error_m(off, anchors), 5.0, atol=0.5)
