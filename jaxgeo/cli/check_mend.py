"""What would mend a finding, as the exact `--set`; a finding itself changes nothing."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from jaxgeo.config.inputs import ControlPointSightingsInput, FromTrajectorySightingsInput
from jaxgeo.config.schema import SessionConfig

if TYPE_CHECKING:
    from calibration.faults import Hypothesis
    from jaxgeo.data import Anchors, Visit

# What a visit is called in an order where its place was not surveyed.
UNSURVEYED = "unsurveyed"


def mend_sentences(
    config: SessionConfig, visits: "Sequence[Visit]", anchors: "Anchors", named: "Hypothesis"
) -> list[str]:
    """How the config would say what was found; empty where nothing is wrong.

    Args:
        visits: all labelled visits, in order of their start.
        anchors: those that the hypothesis is about, in its order.
    """
    if named.kind in ("right", "jump"):
        return []
    if named.kind == "shifted location":
        return [_without(config, anchors.location[named.visits[0]])]
    place_of = dict(zip(anchors.label, named.places, strict=True))
    places = [place_of.get(visit.label, visit.location) for visit in visits]
    if config.visits.order is not None:
        said = order_sentence(config, _with_ignored(config, places))
        return [f"{said} The visit is left out by that." if named.kind == "shifted" else said]
    if named.kind == "shifted":
        return [_without(config, anchors.location[named.visits[0]])]
    return [_by_name(config, visits, places, named, anchors)]


def order_sentence(config: SessionConfig, places: Sequence[str]) -> str:
    """The visiting order as it should be; visits at no surveyed place go by a name that is ignored."""
    ignored = list(config.survey.ignore) if config.survey else []
    chosen = [f"visits.order={_yaml([place or UNSURVEYED for place in places])}"]
    if "" in places and UNSURVEYED not in ignored:
        chosen.append(f"survey.ignore={_yaml([*ignored, UNSURVEYED])}")
    return "If so: " + " ".join(f"--set '{each}'" for each in chosen)


def _with_ignored(config: SessionConfig, places: Sequence[str]) -> list[str]:
    """The labelled visits' places, among those of the order that the config leaves out."""
    ignored = set(config.survey.ignore) if config.survey else set()
    rest = iter(places)
    return [name if name in ignored else next(rest) for name in config.visits.order or []]


def _without(config: SessionConfig, location: str) -> str:
    if config.survey is None:
        return f"Check the coordinates of {location}. To go on without it, remove its rows from the sightings' file."
    ignored = _yaml([*config.survey.ignore, location])
    return (
        f"Check the coordinates of {location}, and whether its marker was moved. To go on without the location, on all "
        f"its visits: --set 'survey.ignore={ignored}'"
    )


def _by_name(
    config: SessionConfig, visits: "Sequence[Visit]", places: Sequence[str], named: "Hypothesis", anchors: "Anchors"
) -> str:
    """Sessions whose visits carry their names: ids of markers, or names of rows."""
    if isinstance(config.sightings, ControlPointSightingsInput | FromTrajectorySightingsInput):
        rows = ", ".join(f"{named.places[i]} at {anchors.stamp_s[i]:.3f} s" for i in named.visits)
        key = "sightings.names" if isinstance(config.sightings, ControlPointSightingsInput) else "sightings.visits"
        return f"If so, name these rows in {key}: {rows}."
    of_marker: dict[str, set[str]] = {}
    for visit, place in zip(visits, places, strict=True):
        of_marker.setdefault(visit.marker, set()).add(place)
    if all(len(found) == 1 for found in of_marker.values()):
        moved = {visit.marker: place for visit, place in zip(visits, places, strict=True) if place != visit.location}
        return f"If so: --set 'visits.locations={_yaml(config.visits.locations | moved)}'"
    markers = sorted({visit.marker for visit in visits if len(of_marker[visit.marker]) > 1})
    return (
        f"If so, markers {', '.join(markers)} were at several places, which an id cannot say: give their sightings "
        "other ids there, or leave them out with survey.ignore."
    )


def _yaml(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)
