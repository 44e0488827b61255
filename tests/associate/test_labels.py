import numpy as np
import pytest

from jaxgeo.associate.labels import label_visits
from jaxgeo.data import Survey, Visit
from jaxgeo.errors import SightingError


def _survey(*names):
    n = len(names)
    return Survey(
        name=names,
        enh_m=np.zeros((n, 3)),
        sigma_m=np.full((n, 3), 0.01),
        quat_grid_marker_wxyz=np.full((n, 4), np.nan),
        sigma_rot_rad=np.full((n, 3), np.nan),
        crs="local",
    )


def _visits(*markers, pauses=None):
    starts = np.cumsum([0.0, *(pauses or [10.0] * (len(markers) - 1))])
    return [
        Visit(marker=marker, sightings=np.arange(3 * i, 3 * i + 3), start_s=float(t), end_s=float(t) + 1.0)
        for i, (marker, t) in enumerate(zip(markers, starts, strict=True))
    ]


def test_labels_by_the_visiting_order():
    labelled, warnings = label_visits(_visits("", "", "", ""), _survey("A", "B"), order=["A", "B", "A", "A"])
    assert [v.location for v in labelled] == ["A", "B", "A", "A"]
    assert [v.label for v in labelled] == ["A", "B", "A_revisit", "A_revisit2"]
    assert [v.start_s for v in labelled] == [0.0, 10.0, 20.0, 30.0]
    assert warnings == ()


def test_the_order_goes_by_time_not_by_the_list():
    labelled, _ = label_visits(_visits("", "")[::-1], _survey("A", "B"), order=["A", "B"])
    assert [(v.label, v.start_s) for v in labelled] == [("A", 0.0), ("B", 10.0)]


def test_labels_by_decoded_id_and_by_a_map():
    labelled, _ = label_visits(_visits("A", "6", "A"), _survey("A", "T6"), locations={"6": "T6"})
    assert [v.label for v in labelled] == ["A", "T6", "A_revisit"]


def test_ids_without_a_location_are_reported_with_their_counts():
    labelled, warnings = label_visits(_visits("A", "381", "9", "381"), _survey("A"))
    assert [v.label for v in labelled] == ["A"]
    assert warnings == (
        "2 ids have no surveyed location and are left out (sightings in visits): "
        "'381' (6 in 2 visits), '9' (3 in 1 visits).",
    )


def test_ignored_locations_are_dropped_without_a_word():
    labelled, warnings = label_visits(_visits("A", "B"), _survey("A", "B"), ignore=["A"])
    assert ([v.label for v in labelled], warnings) == (["B"], ())
    labelled, _ = label_visits(_visits("", "", ""), _survey("A", "B"), order=["A", "B", "A"], ignore=["A"])
    assert [(v.label, v.start_s) for v in labelled] == [("B", 10.0)]
    labelled, warnings = label_visits(
        _visits("A", "166"), _survey("A"), ignore=["166"]
    )  # also where it was not surveyed
    assert ([v.label for v in labelled], warnings) == (["A"], ())


def test_too_many_visits_are_listed_with_the_gap_that_would_join_them():
    with pytest.raises(SightingError) as error:
        label_visits(_visits("", "", "", "", pauses=[10.0, 4.5, 60.0]), _survey("A", "B"), order=["A", "B"])
    message = str(error.value)
    assert "4 visits were found but visits.order names 2: A, B." in message
    assert "2: 10.000 to 11.000 s, 3 sightings" in message
    assert "Raise visits.gap_s (at 9 s " in message  # pauses of 3.5, 9 and 59 s: the two shortest must close


def test_too_few_visits_are_listed_with_a_hint():
    with pytest.raises(
        SightingError, match=r"(?s)1 visits were found but visits.order names 2.*1: 0.000 to 1.000.*Lower visits.gap_s"
    ):
        label_visits(_visits(""), _survey("A", "B"), order=["A", "B"])


def test_an_order_over_several_ids_says_so():
    with pytest.raises(SightingError, match=r"one moved marker, but these visits are of '7', '9'"):
        label_visits(_visits("7", "9"), _survey("A"), order=["A"])


@pytest.mark.parametrize(
    ("markers", "options", "message"),
    [
        (["", ""], {"order": ["A", "X"]}, "visits.order names 'X'. The survey has A, B."),
        (["6"], {"locations": {"6": "T6"}}, "visits.locations names 'T6'. The survey has A, B."),
        (["A", ""], {}, r"1 of 2 visits have no decoded id \(the first from 10.000 s\); give the visiting order"),
        (["8"], {}, r"none of the 1 visits belongs to a surveyed location.*'8' \(3 in 1 visits\).*The survey has A, B"),
    ],
)
def test_visits_that_cannot_be_labelled_are_refused(markers, options, message):
    with pytest.raises(SightingError, match=message):
        label_visits(_visits(*markers), _survey("A", "B"), **options)
