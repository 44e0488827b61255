"""What may be wrong with labels: every hypothesis once, and none that is not wrong."""

import math

import pytest

from calibration.faults import hypotheses as of
from calibration.faults.finding import fault_words
from calibration.faults.hypotheses import FREE, Hypothesis

TOLD = ("A", "B", "C", "D", "E", "F", "A")
NAMES = ("A", "B", "C", "D", "E", "F")


def differing(h: Hypothesis) -> tuple[int, ...]:
    return tuple(i for i, name in enumerate(TOLD) if h.places[i] != name)


@pytest.mark.parametrize(
    ("found", "count"),
    [
        (of.mislabelled(TOLD, NAMES), 7 * 5),
        # Pairs of visits that are not both A's, and the exchanges of A, on both visits, with five others.
        (of.exchanged(TOLD), math.comb(7, 2) - 1 + 5),
        (of.shifted(TOLD), 7),
    ],
    ids=["mislabelled", "exchanged", "shifted"],
)
def test_each_is_wrong_where_it_says_and_there_once(found, count):
    assert len(found) == count
    assert len({h.places for h in found}) == count
    assert all(differing(h) == h.visits for h in found)


def test_exchanged_keeps_the_names():
    for h in of.exchanged(TOLD)[:20]:
        assert sorted(h.places) == sorted(TOLD)
    whole = [h for h in of.exchanged(TOLD) if len(h.visits) == 3]
    assert {h.places[0] for h in whole} == set("BCDEF")
    assert all(h.places[0] == h.places[6] for h in whole)


def test_slipped_is_a_place_missed_and_a_visit_more():
    found = of.slipped(TOLD)
    assert len({h.places for h in found}) == len(found)
    for h in found:
        assert differing(h) == h.visits
        assert len(h.visits) > 1
    # B missed, and the visit of D seen as two; and a stop between A and B, with F missed.
    places = {h.places for h in found}
    assert ("A", "C", "D", "D", "E", "F", "A") in places
    assert ("A", FREE, "B", "C", "D", "E", "A") in places
    assert ("A", "A", "B", "C", "D", "E", "A") in places
    # Far from its neighbours an extra visit is nowhere that was surveyed.
    assert ("A", "E", "B", "C", "D", "E", "A") not in places


def test_a_location_is_shifted_where_it_has_several_visits():
    (only,) = of.shifted_locations(TOLD)
    assert only.visits == (0, 6)
    assert only.places == TOLD


def test_alignments_are_by_one_visit():
    missed = of.alignments(TOLD, 6, NAMES)
    assert len(missed) == 7
    assert all(len(h.places) == 6 for h in missed)
    assert {h.places for h in missed if h.visits == (2,)} == {("A", "B", "D", "E", "F", "A")}
    extra = of.alignments(TOLD, 8, NAMES)
    assert len({h.places for h in extra}) == len(extra)
    for h in extra:
        at = h.visits[0]
        assert (*h.places[:at], *h.places[at + 1 :]) == TOLD
    # Any place, or none, at eight positions; each of the seven twins once, not before and after.
    assert len(extra) == 8 * 7 - 7
    with pytest.raises(ValueError, match="5 visits for an order of 7"):
        of.alignments(TOLD, 5, NAMES)


@pytest.mark.parametrize(
    ("h", "said"),
    [
        (of.right(TOLD), "the labels are right"),
        (Hypothesis("mislabelled", (2,), ("A", "B", "E", "D", "E", "F", "A")), "visit 3 (C) is at E"),
        (of.shifted(TOLD)[3], "visit 4 (D) is not where it was surveyed"),
        (of.shifted_locations(TOLD)[0], "location A is not where it was surveyed"),
        (of.jumps(TOLD)[5], "the odometry jumps between the visits 6 (F) and 7 (A)"),
        (of.exchanged(TOLD)[0], "the visits 1 (A) and 2 (B) are exchanged"),
        (of.exchanged(TOLD)[-1], "the visits 1 (A), 6 (F) and 7 (A) are exchanged: A with F"),
        (Hypothesis("missed", (2,), ("A", "B", "D", "E", "F", "A")), "place 3 of the order (C) was missed"),
        (Hypothesis("extra", (1,), ("A", FREE, *TOLD[1:])), "visit 2 is extra (nowhere that was surveyed)"),
        (Hypothesis("slipped", (1, 2), ("A", FREE, "B", "D", "E", "F", "A")), "A ? B D E F A"),
    ],
)
def test_words_count_visits_from_one_and_name_them_as_told(h, said):
    assert said in fault_words(h, TOLD)
