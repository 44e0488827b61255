"""What people do wrong: a surveyed point that moved, names exchanged, a wrong label, a clock that is off."""

import dataclasses

import numpy as np

from jaxgeo.data import Survey
from jaxgeo.errors import InputError
from jaxgeo.simulate.layout import LOCATIONS, Layout

Axes = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Faults:
    """Faults put into a session's inputs; its truth stays what it is. Visits are counted from 1.

    Attributes:
        shifted_enh_m: (location, (E, N, h)): its surveyed coordinates are off by this.
        swapped_locations: pairs of locations whose surveyed coordinates are exchanged.
        swapped_visits: pairs of visits whose names are exchanged in the visiting order.
        mislabelled_visits: (visit, location): it goes by another location's name in the visiting order.
        time_offset_s: the sightings' stamps are late by this on the trajectory's clock.

    Raises:
        InputError: a shift or the time offset is not finite.
    """

    shifted_enh_m: tuple[tuple[str, Axes], ...] = ()
    swapped_locations: tuple[tuple[str, str], ...] = ()
    swapped_visits: tuple[tuple[int, int], ...] = ()
    mislabelled_visits: tuple[tuple[int, str], ...] = ()
    time_offset_s: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.time_offset_s):
            raise InputError(f"time_offset_s: {self.time_offset_s}; expected a finite number of seconds.")
        for name, shift_m in self.shifted_enh_m:
            if not np.all(np.isfinite(shift_m)):
                raise InputError(
                    f"shifted location {name!r}: {shift_m}; expected three finite numbers, metres E, N, h."
                )


def faulty_survey(survey: Survey, faults: Faults) -> Survey:
    """The survey with its faults: exchanged first, then shifted.

    Raises:
        InputError: a location that the survey does not have or one exchanged with itself.
    """
    enh_m = survey.enh_m.copy()
    for one, other in faults.swapped_locations:
        i, j = _location(survey.name, one), _location(survey.name, other)
        if i == j:
            raise InputError(f"swapped locations: {one!r} with itself; expected two different locations.")
        enh_m[[i, j]] = enh_m[[j, i]]
    for name, shift_m in faults.shifted_enh_m:
        enh_m[_location(survey.name, name)] += shift_m
    return dataclasses.replace(survey, enh_m=enh_m)


def faulty_order(layout: Layout, faults: Faults) -> tuple[str, ...]:
    """The visiting order as it is told: exchanged first, then mislabelled.

    Raises:
        InputError: a visit or a location that the layout does not have, or a visit exchanged with itself.
    """
    order = list(layout.order)
    for one, other in faults.swapped_visits:
        i, j = _visit(order, one), _visit(order, other)
        if i == j:
            raise InputError(f"swapped visits: {one} with itself; expected two different visits.")
        order[i], order[j] = order[j], order[i]
    for visit, name in faults.mislabelled_visits:
        _location(LOCATIONS, name)
        order[_visit(order, visit)] = name
    return tuple(order)


def _location(names: tuple[str, ...], name: str) -> int:
    if name not in names:
        raise InputError(f"fault at location {name!r}: the site has {', '.join(names)}.")
    return names.index(name)


def _visit(order: list[str], visit: int) -> int:
    if not 1 <= visit <= len(order):
        raise InputError(f"fault at visit {visit}: the session has visits 1 to {len(order)} ({', '.join(order)}).")
    return visit - 1
