"""Visits tied to surveyed locations: by decoded id, or by the order in which one moved marker was visited."""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from jaxgeo.data import Survey, Visit
from jaxgeo.errors import SightingError


def label_visits(
    visits: Sequence[Visit],
    survey: Survey,
    *,
    order: Sequence[str] | None = None,
    locations: Mapping[str, str] | None = None,
    ignore: Collection[str] = (),
) -> tuple[list[Visit], tuple[str, ...]]:
    """Visits with location and label, in order of their start, and warnings.

    With `order`, visit i is location order[i]. Without it a visit's decoded id is its location's name, or is looked up
    in `locations` first. Visits of locations in `ignore` are dropped without a word; ids without a surveyed
    location are dropped with a warning that lists them and their counts. Labels: A, A_revisit, A_revisit2 ...

    Raises:
        SightingError: another number of visits than `order` names (the visits found are listed); a location that the
            survey does not have; ids unknown and no order given; no visit left.
    """
    visits = sorted(visits, key=lambda visit: visit.start_s)
    known = set(survey.name) | set(ignore)
    if order is not None:
        _check_names(order, known, survey, "visits.order")
        if len(order) != len(visits):
            raise SightingError(_wrong_number(visits, order))
        named, warnings = list(zip(visits, order, strict=True)), ()
    else:
        locations = locations or {}
        _check_names(locations.values(), known, survey, "visits.locations")
        named, warnings = _by_id(visits, known, locations)
    seen: Counter[str] = Counter()
    labelled = []
    for visit, location in named:
        if location not in ignore:
            again = seen[location]
            label = location if again == 0 else f"{location}_revisit{again if again > 1 else ''}"
            labelled.append(dataclasses.replace(visit, location=location, label=label))
            seen[location] += 1
    if not labelled:
        raise SightingError(
            f"none of the {len(visits)} visits belongs to a surveyed location. "
            + " ".join(warnings)
            + f" {_survey_has(survey)}"
        )
    return labelled, warnings


def _by_id(
    visits: Sequence[Visit], known: Collection[str], locations: Mapping[str, str]
) -> tuple[list[tuple[Visit, str]], tuple[str, ...]]:
    unknown = [visit for visit in visits if visit.marker == ""]
    if unknown:
        raise SightingError(
            f"{len(unknown)} of {len(visits)} visits have no decoded id (the first from {unknown[0].start_s:.3f} s); "
            "give the visiting order (`visits.order`), one location name a visit."
        )
    named = [(visit, locations.get(visit.marker, visit.marker)) for visit in visits]
    sightings: Counter[str] = Counter()
    runs: Counter[str] = Counter()
    for visit, location in named:
        if location not in known:
            sightings[visit.marker] += visit.count
            runs[visit.marker] += 1
    if not sightings:
        return named, ()
    listed = ", ".join(f"'{marker}' ({sightings[marker]} in {runs[marker]} visits)" for marker in sorted(sightings))
    warning = f"{len(sightings)} ids have no surveyed location and are left out (sightings in visits): {listed}."
    return [pair for pair in named if pair[1] in known], (warning,)


def _check_names(names: Collection[str], known: Collection[str], survey: Survey, where: str) -> None:
    missing = sorted({name for name in names if name not in known})
    if missing:
        raise SightingError(
            f"{where} names {', '.join(map(repr, missing))}. {_survey_has(survey)} Mend the name, or survey the point."
        )


def _survey_has(survey: Survey) -> str:
    more = f" ... ({len(survey)} in all)" if len(survey) > 20 else ""
    return f"The survey has {', '.join(survey.name[:20])}{more}."


def _wrong_number(visits: Sequence[Visit], order: Sequence[str]) -> str:
    rows = "\n".join(
        f"  {i + 1}: {visit.start_s:.3f} to {visit.end_s:.3f} s, {visit.count} sightings"
        + (f", id '{visit.marker}'" if visit.marker else "")
        for i, visit in enumerate(visits)
    )
    return (
        f"{len(visits)} visits were found but visits.order names {len(order)}: {', '.join(order)}.\n{rows}\n"
        + _hint(visits, len(visits) - len(order))
        + (" 'jaxgeo check' says which one it is." if abs(len(visits) - len(order)) == 1 else "")
    )


def _hint(visits: Sequence[Visit], too_many: int) -> str:
    if too_many < 0:
        return (
            "Lower visits.gap_s, so that more pauses part visits, or look for a place where the marker was not "
            "detected."
        )
    pauses = sorted(
        later.start_s - earlier.end_s for earlier, later in itertools.pairwise(visits) if later.marker == earlier.marker
    )
    if too_many > len(pauses):
        ids = ", ".join(repr(marker) for marker in sorted({visit.marker for visit in visits}))
        return f"An order is for one moved marker, but these visits are of {ids}; leave out the order, or stray ids."
    return (
        f"Raise visits.gap_s (at {pauses[too_many - 1]:.3g} s the shortest pauses close and as many visits are left as "
        "the order names), or raise visits.min_count to leave out stray detections."
    )
