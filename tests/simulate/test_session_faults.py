"""Faults change what is told, where they are put, and never the truth."""

import numpy as np
import pytest

from jaxgeo.errors import InputError
from jaxgeo.simulate import Drift, Faults, raw_revisit_gaps_m, simulate_session

NO_DRIFT = {"icp": Drift()}


@pytest.fixture(scope="module")
def sound():
    return simulate_session(2, drift=NO_DRIFT)


def made(**faults):
    return simulate_session(2, drift=NO_DRIFT, faults=Faults(**faults))


def rows(session, *names):
    return session.survey.enh_m[[session.survey.index(name) for name in names]]


def test_a_shifted_location_is_off_by_the_shift_alone(sound):
    shifted = made(shifted_enh_m=(("C", (5.0, -1.0, 0.5)),))
    np.testing.assert_allclose(rows(shifted, "C") - rows(sound, "C"), [[5.0, -1.0, 0.5]])
    np.testing.assert_array_equal(rows(shifted, *"ABDEF"), rows(sound, *"ABDEF"))
    np.testing.assert_array_equal(shifted.marker_enh_m["C"], sound.marker_enh_m["C"])
    np.testing.assert_array_equal(shifted.sightings.t_body_marker_m, sound.sightings.t_body_marker_m)


def test_swapped_locations_have_each_others_coordinates(sound):
    swapped = made(swapped_locations=(("B", "E"),))
    np.testing.assert_array_equal(rows(swapped, *"BE"), rows(sound, *"EB"))
    np.testing.assert_array_equal(rows(swapped, *"ACDF"), rows(sound, *"ACDF"))
    assert swapped.order == sound.order


def test_swapped_visits_and_labels_change_the_order_told(sound):
    assert "".join(made(swapped_visits=((2, 5),)).order) == "AECDBFA"
    assert "".join(made(mislabelled_visits=((3, "D"),)).order) == "ABDDEFA"
    assert "".join(made(swapped_visits=((1, 2), (2, 3)), mislabelled_visits=((7, "F"),)).order) == "BCADEFF"
    assert "".join(sound.layout.order) == "ABCDEFA"


def test_a_time_offset_is_in_the_sightings_stamps_alone(sound):
    late = made(time_offset_s=0.2)
    np.testing.assert_allclose(late.sightings.stamp_s - sound.sightings.stamp_s, 0.2, atol=1e-6)
    np.testing.assert_array_equal(late.sightings.t_body_marker_m, sound.sightings.t_body_marker_m)
    np.testing.assert_array_equal(late.truth.stamp_s, sound.truth.stamp_s)
    # The truth of the session, the gap of its revisits, does not know of it.
    np.testing.assert_allclose(raw_revisit_gaps_m(late, "icp")["A"], raw_revisit_gaps_m(sound, "icp")["A"], atol=1e-6)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shifted_enh_m": (("G", (1.0, 0.0, 0.0)),)}, "fault at location 'G': the site has A, B, C, D, E, F"),
        ({"shifted_enh_m": (("C", (1.0, float("nan"), 0.0)),)}, "expected three finite numbers"),
        ({"swapped_locations": (("B", "B"),)}, "'B' with itself"),
        ({"swapped_visits": ((0, 2),)}, "fault at visit 0: the session has visits 1 to 7"),
        ({"swapped_visits": ((3, 3),)}, "3 with itself"),
        ({"mislabelled_visits": ((8, "A"),)}, "fault at visit 8"),
        ({"mislabelled_visits": ((1, "Z"),)}, "fault at location 'Z'"),
        ({"time_offset_s": float("inf")}, "time_offset_s: inf"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        made(**given)
