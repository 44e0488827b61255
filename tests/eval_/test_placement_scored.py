"""Choices of anchors corrected alone: as a fold that leaves out the rest, and judged by the rest."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from eval_.small_problem import LEARN, SETTINGS, SHIFT_M, problem, shifted, three_on_a_line

from calibration.calibrate import learn_options
from calibration.learn import learn_fold, prior_arrays
from eval.placement.scored import _filled, corrected_with, marker_error_m, of_locations
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of

CHOICE = np.array([True, False, True, True, True, False])  # A C D E


@pytest.fixture(scope="module")
def session():
    return problem()


def chosen(trajectory, anchors, *choices):
    return list(corrected_with(trajectory, anchors, np.array(choices), SETTINGS, LEARN))


def test_a_choice_is_corrected_by_its_visits_alone(session):
    trajectory, anchors = session
    found = chosen(trajectory, anchors, CHOICE)[0]
    assert found.determined
    # The fold of the same anchors, all in one table, predicts the markers that it leaves out.
    chain = chain_of(trajectory)
    use = np.zeros(8)
    use[: len(anchors)] = CHOICE[anchors.location_index]
    learned = learn_fold(
        chain,
        anchor_table(anchors, chain),
        prior_arrays(LEARN.family),
        jnp.asarray(use),
        jnp.asarray(SETTINGS.loss_width),
        learn_options(SETTINGS, LEARN),
    )
    predicted = np.linalg.norm(np.asarray(learned.fold.point_m)[:7] - anchors.surveyed_enh_m, axis=1)
    np.testing.assert_allclose(marker_error_m(found.corrected, anchors), predicted, atol=5e-3)
    # Nothing of what was left out is read.
    moved = chosen(trajectory, shifted(anchors, "B"), CHOICE)[0]
    np.testing.assert_array_equal(moved.corrected.position_m, found.corrected.position_m)
    error = marker_error_m(found.corrected, anchors)
    apart = marker_error_m(moved.corrected, shifted(anchors, "B")) - error
    assert abs(apart[1]) > 0.5 * np.linalg.norm(SHIFT_M)
    assert np.all(apart[[0, 2, 3, 4, 5, 6]] == 0.0)


def test_a_wider_table_has_more_padding_and_nothing_else(session):
    trajectory, anchors = session
    table = anchor_table(of_locations(anchors, CHOICE), chain_of(trajectory))
    wide = _filled(table, 12)
    np.testing.assert_array_equal(wide.later_than, table.later_than)
    for name, column in vars(table).items():
        if name != "later_than":
            assert len(getattr(wide, name)) == 12
            np.testing.assert_array_equal(getattr(wide, name)[:8], column)
    for name in ("real", "pose_index", "has_rotation", "location"):
        np.testing.assert_array_equal(getattr(wide, name)[8:], np.repeat(getattr(table, name)[7:], 4))
    whole = anchor_table(anchors, chain_of(trajectory))
    assert float(_filled(whole, 10).real.sum()) == 7.0


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
