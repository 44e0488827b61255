"""What can be wrong with the labels of a session's visits: every hypothesis as plain data.

A hypothesis gives every visit a place: the name of a surveyed location, or FREE where its position is open. One visit
may be at another location (mislabelled), or off by an unknown shift (of the survey, or the marker was moved); two
visits, or two locations' coordinates, may be exchanged; in a visiting order a place may have been missed and another
visit be extra, so that the labels between slip by one. Where all labels are right, the odometry may have jumped.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Literal

FREE = ""
Kind = Literal["right", "mislabelled", "exchanged", "slipped", "shifted", "shifted location", "jump", "missed", "extra"]


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """One way in which the labels may be wrong.

    Attributes:
        kind: `missed` and `extra` are of a number of visits that is not the order's: place, or visit, `visits[0]`.
        visits: the visits that are wrong, from 0; empty for `right`; of a jump the two that it lies between.
        places: location of every visit; FREE where it is none of the survey's, or off by an unknown shift.
    """

    kind: Kind
    visits: tuple[int, ...]
    places: tuple[str, ...]

    @property
    def of_labels(self) -> bool:
        """Whether names are wrong, not a position."""
        return self.kind not in ("right", "shifted", "shifted location", "jump")


def right(told: Sequence[str]) -> Hypothesis:
    return Hypothesis("right", (), tuple(told))


def mislabelled(told: Sequence[str], names: Sequence[str]) -> list[Hypothesis]:
    """Each visit at each other location."""
    return [
        Hypothesis("mislabelled", (j,), replaced(told, {j: name}))
        for j in range(len(told))
        for name in names
        if name != told[j]
    ]


def shifted(told: Sequence[str]) -> list[Hypothesis]:
    """Each visit's position open: entry j is of visit j."""
    return [Hypothesis("shifted", (j,), replaced(told, {j: FREE})) for j in range(len(told))]


def shifted_locations(told: Sequence[str]) -> list[Hypothesis]:
    """Each location with several visits, its survey off by one shift for all of them."""
    of_name = {name: tuple(j for j, other in enumerate(told) if other == name) for name in dict.fromkeys(told)}
    return [Hypothesis("shifted location", visits, tuple(told)) for visits in of_name.values() if len(visits) > 1]


def jumps(told: Sequence[str]) -> list[Hypothesis]:
    """The odometry jumps between two visits: entry j is between j and j + 1."""
    return [Hypothesis("jump", (j, j + 1), tuple(told)) for j in range(len(told) - 1)]


def exchanged(told: Sequence[str]) -> list[Hypothesis]:
    """Two visits' labels, or two locations' coordinates, exchanged; what gives the same places is named once."""
    found: dict[tuple[str, ...], Hypothesis] = {}
    for i, j in itertools.combinations(range(len(told)), 2):
        if told[i] != told[j]:
            places = replaced(told, {i: told[j], j: told[i]})
            found.setdefault(places, Hypothesis("exchanged", (i, j), places))
    for one, other in itertools.combinations(dict.fromkeys(told), 2):
        turn = {one: other, other: one}
        places = tuple(turn.get(name, name) for name in told)
        visits = tuple(i for i, name in enumerate(told) if name in turn)
        found.setdefault(places, Hypothesis("exchanged", visits, places))
    return list(found.values())


def slipped(told: Sequence[str]) -> list[Hypothesis]:
    """One place of the order missed and one visit extra: labels between slip by one.

    Where only one visit's place changes by that, it is a mislabelled one, and not named here.
    """
    found: dict[tuple[str, ...], Hypothesis] = {}
    for missed, extra in itertools.permutations(range(len(told)), 2):
        rest = [name for i, name in enumerate(told) if i != missed]
        # One visit seen as two is where a neighbour is.
        near = [rest[i] for i in (extra - 1, extra) if 0 <= i < len(rest)]
        for places in _with_extra(rest, extra, near):
            wrong = tuple(i for i, name in enumerate(told) if places[i] != name)
            if len(wrong) > 1:
                found.setdefault(places, Hypothesis("slipped", wrong, places))
    return list(found.values())


def alignments(order: Sequence[str], visits: int, names: Sequence[str]) -> list[Hypothesis]:
    """One visit more, or fewer, than the order names: which visit is extra, or which place was missed.

    An extra visit is at any of the survey's `names`, or nowhere that was surveyed.

    Raises:
        ValueError: another difference.
    """
    if visits == len(order) - 1:
        missed = (
            Hypothesis("missed", (i,), tuple(name for j, name in enumerate(order) if j != i)) for i in range(len(order))
        )
        return list({h.places: h for h in missed}.values())
    if visits == len(order) + 1:
        extra = (Hypothesis("extra", (i,), places) for i in range(visits) for places in _with_extra(order, i, names))
        return list({h.places: h for h in extra}.values())
    raise ValueError(f"{visits} visits for an order of {len(order)}; one more or one fewer can be aligned.")


def replaced(told: Sequence[str], change: Mapping[int, str]) -> tuple[str, ...]:
    """The places with some of them changed."""
    return tuple(change.get(i, name) for i, name in enumerate(told))


def _with_extra(order: Sequence[str], extra: int, names: Sequence[str]) -> list[tuple[str, ...]]:
    """An extra visit put into an order, at any of the names or nowhere that was surveyed."""
    return [(*order[:extra], place, *order[extra:]) for place in (FREE, *dict.fromkeys(names))]
