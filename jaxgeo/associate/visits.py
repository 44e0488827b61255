"""Sightings cut into visits at time gaps."""

import numpy as np

from jaxgeo.data import CornerSightings, Sightings, Visit
from jaxgeo.errors import SightingError


def cut_visits(sightings: Sightings | CornerSightings, gap_s: float, min_count: int = 1) -> list[Visit]:
    """Runs of sightings of one marker with no gap longer than `gap_s`, in order of their start.

    Sightings without an id count as sightings of one moved marker. All cameras of the rig share a visit. Runs of fewer
    than `min_count` sightings are no visits.

    Raises:
        SightingError: no sightings, or none that make a visit; `gap_s` or `min_count` out of range.
    """
    if not (np.isfinite(gap_s) and gap_s > 0.0):
        raise SightingError(f"gap_s is {gap_s}; expected the longest pause inside a visit, above zero, in seconds.")
    if min_count < 1:
        raise SightingError(f"min_count is {min_count}; expected the least number of sightings of a visit, 1 or more.")
    visits = []
    for marker in np.unique(sightings.marker):
        rows = np.flatnonzero(sightings.marker == marker)
        rows = rows[np.argsort(sightings.stamp_s[rows], kind="stable")]
        breaks = np.flatnonzero(np.diff(sightings.stamp_s[rows]) > gap_s) + 1
        visits += [_visit(str(marker), run, sightings) for run in np.split(rows, breaks) if len(run) >= min_count]
    if not visits:
        raise SightingError(
            f"{len(sightings)} sightings make no visit of {min_count} or more; "
            "check the sightings file, or lower min_count."
        )
    return sorted(visits, key=lambda visit: (visit.start_s, visit.marker))


def _visit(marker: str, rows: np.ndarray, sightings: Sightings | CornerSightings) -> Visit:
    first, last = sightings.stamp_s[rows[[0, -1]]]
    return Visit(marker=marker, sightings=rows, start_s=float(first), end_s=float(last))
