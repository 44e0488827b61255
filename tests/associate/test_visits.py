import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marker_scene import point_sightings

from jaxgeo.associate.visits import cut_visits
from jaxgeo.errors import SightingError


def _seen(stamps, markers):
    return point_sightings(np.array(stamps), np.zeros((len(stamps), 3)), marker=markers)


def test_runs_are_cut_at_gaps_and_by_marker():
    sightings = _seen([0.0, 1.0, 6.0, 11.5, 3.0, 4.0], ["a", "a", "a", "a", "b", "b"])
    visits = cut_visits(sightings, gap_s=5.0)
    assert [(v.marker, v.sightings.tolist(), v.start_s, v.end_s) for v in visits] == [
        ("a", [0, 1, 2], 0.0, 6.0),  # a pause of exactly gap_s does not part
        ("b", [4, 5], 3.0, 4.0),
        ("a", [3], 11.5, 11.5),
    ]
    assert [v.count for v in visits] == [3, 2, 1]


def test_two_cameras_share_a_visit_and_unsorted_rows_come_in_time_order():
    visits = cut_visits(_seen([2.0, 0.0, 2.0, 1.0], [""] * 4), gap_s=1.0)
    assert len(visits) == 1
    assert visits[0].sightings.tolist() == [1, 3, 0, 2]


def test_short_runs_are_no_visits():
    sightings = _seen([0.0, 0.1, 0.2, 50.0], [""] * 4)
    assert [v.count for v in cut_visits(sightings, 5.0, min_count=2)] == [3]
    with pytest.raises(SightingError, match="4 sightings make no visit of 9 or more"):
        cut_visits(sightings, 5.0, min_count=9)


@given(st.lists(st.tuples(st.integers(0, 300), st.sampled_from("abc")), min_size=1, max_size=60), st.integers(1, 20))
def test_every_sighting_is_in_one_visit_and_gaps_decide(rows, gap_s):
    stamps, markers = (list(column) for column in zip(*rows, strict=True))
    sightings = _seen(np.array(stamps, dtype=np.float64), markers)
    visits = cut_visits(sightings, float(gap_s))
    assert sorted(np.concatenate([v.sightings for v in visits]).tolist()) == list(range(len(rows)))
    assert [v.start_s for v in visits] == sorted(v.start_s for v in visits)
    for marker in "abc":
        mine = [v for v in visits if v.marker == marker]
        assert all(later.start_s - earlier.end_s > gap_s for earlier, later in itertools.pairwise(mine))
    for v in visits:
        assert np.all(sightings.marker[v.sightings] == v.marker)
        assert np.all(np.diff(sightings.stamp_s[v.sightings]) <= gap_s)


@pytest.mark.parametrize(
    ("gap_s", "min_count", "message"), [(0.0, 1, "gap_s is 0.0"), (np.nan, 1, "gap_s"), (1.0, 0, "min_count is 0")]
)
def test_senseless_settings_are_refused(gap_s, min_count, message):
    with pytest.raises(SightingError, match=message):
        cut_visits(_seen([0.0], ["a"]), gap_s, min_count)
