"""Visits as sightings come: the very visits that are cut when all is there."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from jaxgeo.associate import cut_visits
from jaxgeo.data import Sightings
from jaxgeo.errors import SightingError
from jaxgeo.online.visit_log import VisitLog

GAP_S = 1.0
rows_of = st.lists(st.tuples(st.integers(0, 40), st.sampled_from(["A", "longer", ""])), min_size=1, max_size=30)


def sightings_at(stamp_s, marker) -> Sightings:
    n = len(stamp_s)
    return Sightings(
        stamp_s=np.asarray(stamp_s, dtype=float),
        marker=np.asarray(marker),
        t_body_marker_m=np.zeros((n, 3)),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=np.tile(np.eye(6), (n, 1, 1)),
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"row {i}" for i in range(n)]),
    )


def facts(visits) -> list[tuple]:
    return [(v.marker, v.start_s, v.end_s, v.sightings.tolist()) for v in visits]


@given(rows_of, st.integers(1, 3), st.lists(st.booleans(), min_size=30, max_size=30))
def test_any_order_of_arrival_gives_the_visits_of_cut_visits(rows, min_count, closed_after):
    # Quarters of a second: gaps of exactly one second occur.
    made = sightings_at([0.25 * stamp for stamp, _ in rows], [marker for _, marker in rows])
    log = VisitLog(GAP_S, min_count)
    for i in range(len(rows)):
        log.push(made.take(np.array([i])))
        if closed_after[i]:
            log.close(made.stamp_s[: i + 1].max())
    log.close(np.inf)
    try:
        expected = cut_visits(made, GAP_S, min_count)
    except SightingError:  # none is long enough
        expected = []
    assert facts(log.visits()) == facts(expected)
    assert log.open_count == 0


def test_a_visit_ends_when_a_pose_comes_later_than_the_gap():
    log = VisitLog(GAP_S)
    log.push(sightings_at([5.0, 5.5], ["A", "A"]))
    assert (log.close(6.5), log.open_count, log.visits()) == (0, 1, [])
    assert (log.close(6.6), log.open_count) == (1, 0)
    assert log.close(7.0) == 0
    # Once in use it stays in use: a late sighting changes it at once.
    log.push(sightings_at([6.4], ["A"]))
    assert facts(log.visits()) == [("A", 5.0, 6.4, [0, 1, 2])]
    assert log.close(7.0) == 1


def test_a_sighting_between_two_visits_makes_them_one():
    log = VisitLog(GAP_S)
    log.push(sightings_at([5.0, 6.8], ["A", "A"]))
    assert log.close(9.0) == 2
    log.push(sightings_at([6.0], ["A"]))
    assert log.close(9.0) == 1
    assert facts(log.visits()) == [("A", 5.0, 6.8, [0, 2, 1])]


def test_too_few_sightings_are_no_visit_yet():
    log = VisitLog(GAP_S, min_count=2)
    log.push(sightings_at([5.0], ["A"]))
    assert (log.close(9.0), log.visits()) == (0, [])
    log.push(sightings_at([5.5], ["A"]))
    assert log.close(9.0) == 1


@pytest.mark.parametrize("values", [(0.0, 1), (np.nan, 1), (np.inf, 1), (1.0, 0)])
def test_what_cannot_cut(values):
    with pytest.raises(SightingError, match="expected"):
        VisitLog(*values)
