"""Sightings against the trajectory's time: what lies outside it, and what falls into its pauses."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from jaxgeo.data import Sightings, Trajectory, Visit
from jaxgeo.errors import SightingError

_FEW = 0.05  # share of sightings that may fall outside the trajectory's time before it is an error
_PAUSE_S = 1.0  # a pause between poses this long, and ten times the usual one, is worth a warning


def within_trajectory(
    trajectory: Trajectory, sightings: Sightings, visits: Sequence[Visit]
) -> tuple[list[Visit], tuple[str, ...]]:
    """Visits without the sightings outside the trajectory's time, and a warning where there were any.

    Raises:
        SightingError: 5 % or more lie outside.
    """
    start_s, end_s = trajectory.stamp_s[[0, -1]]
    used = np.concatenate([visit.sightings for visit in visits])
    stamp_s = sightings.stamp_s[used]
    outside = ~((stamp_s >= start_s) & (stamp_s <= end_s))
    if not outside.any():
        return list(visits), ()
    first = used[outside][np.argmin(stamp_s[outside])]
    what = (
        f"{np.count_nonzero(outside)} of {len(used)} sightings lie outside the trajectory's time, "
        f"the first at {sightings.stamp_s[first]:.3f} s ({sightings.source[first]}); the trajectory runs from "
        f"{start_s:.3f} to {end_s:.3f} s, the sightings from {stamp_s.min():.3f} to {stamp_s.max():.3f} s"
    )
    if outside.mean() > 0.5:
        raise SightingError(
            f"{what}. The clocks differ: an offset, or another epoch or unit "
            "(seconds since the start against Unix time, nanoseconds against seconds)."
        )
    if outside.mean() >= _FEW:
        raise SightingError(
            f"{what}. The trajectory seems cut, or the clocks are some seconds apart: "
            "use the whole trajectory, bring both to one clock, or drop the sightings beyond it."
        )
    return _without(used[outside], sightings, visits, what)


def pauses_met(trajectory: Trajectory, sightings: Sightings, visits: Sequence[Visit]) -> tuple[str, ...]:
    """A warning where sightings fall into a long pause of the trajectory: there interpolation is a guess."""
    pause_s = np.diff(trajectory.stamp_s)
    if pause_s.size == 0:
        return ()
    used = np.concatenate([visit.sightings for visit in visits])
    stamp_s = sightings.stamp_s[used]
    before = np.clip(np.searchsorted(trajectory.stamp_s, stamp_s, side="right") - 1, 0, len(pause_s) - 1)
    long = pause_s > max(_PAUSE_S, 10.0 * float(np.median(pause_s)))
    inside = long[before] & ~np.isin(stamp_s, trajectory.stamp_s)
    if not inside.any():
        return ()
    first = used[inside][0]
    return (
        f"{np.count_nonzero(inside)} of {len(used)} sightings fall into pauses of the trajectory of up to "
        f"{pause_s[before[inside]].max():.1f} s, the first at {sightings.stamp_s[first]:.3f} s "
        f"({sightings.source[first]}): their poses are interpolated across the pause.",
    )


def _without(
    dropped: Int[np.ndarray, "m"], sightings: Sightings, visits: Sequence[Visit], what: str
) -> tuple[list[Visit], tuple[str, ...]]:
    kept, lost = [], []
    for visit in visits:
        rows = visit.sightings[~np.isin(visit.sightings, dropped)]
        if rows.size == 0:
            lost.append(visit.label)
            continue
        start_s, end_s = sightings.stamp_s[rows[[0, -1]]]
        kept.append(dataclasses.replace(visit, sightings=rows, start_s=float(start_s), end_s=float(end_s)))
    whole = f", and with them the whole of visit {', '.join(lost)}" if lost else ""
    return kept, (f"{what}; they are left out{whole}.",)
