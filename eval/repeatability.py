"""How closely the sightings of a visit agree: RMS of the composed marker positions about the visit's centroid."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxgeo.data import Anchors
from jaxgeo.export.metrics import pooled_repeatability_m


@dataclasses.dataclass(frozen=True)
class VisitRepeatability:
    """One visit: `count` sightings, `rms_m` the root mean square of their distances from their centroid; NaN of one."""

    label: str
    location: str
    count: int
    rms_m: float


@dataclasses.dataclass(frozen=True)
class Repeatability:
    """Every visit in visiting order, and all sightings together, each about the centroid of its own visit."""

    visits: tuple[VisitRepeatability, ...]
    count: int
    rms_m: float


def repeatability(anchors: Anchors) -> Repeatability:
    """Of one session; the positions are composed with the measured trajectory, before anything is corrected."""
    rows = zip(anchors.label, anchors.location, anchors.count, anchors.repeatability_m, strict=True)
    return _pooled(
        tuple(
            VisitRepeatability(label, place, int(n), float(rms_m) if n > 1 else np.nan)
            for label, place, n, rms_m in rows
        )
    )


def pooled_repeatability(sessions: Sequence[Repeatability]) -> Repeatability:
    """Of several sessions: all their visits, and all sightings together."""
    return _pooled(tuple(visit for session in sessions for visit in session.visits))


def _pooled(visits: tuple[VisitRepeatability, ...]) -> Repeatability:
    several = [visit for visit in visits if visit.count > 1]
    count, rms_m = np.array([v.count for v in several]), np.array([v.rms_m for v in several])
    pooled_m = pooled_repeatability_m(rms_m, count) if several else float("nan")
    return Repeatability(visits, sum(visit.count for visit in visits), pooled_m)
