"""The sightings so far, cut into visits as they come: late, out of order, or before the first pose."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import Sightings, Visit
from jaxgeo.errors import SightingError

_FIRST_ROOM = 64


@dataclasses.dataclass(eq=False)
class Run:
    """Sightings of one marker with no gap longer than the visits' gap; `rows` in any order.

    `used`: it closed once, and serves as an anchor. `visit`: made when first asked for; another sighting makes another
    run.
    """

    marker: str
    rows: list[int]
    start_s: float
    end_s: float
    used: bool = False
    visit: Visit | None = None


class VisitLog:
    """Runs of sightings. Whatever the order of arrival, they are the visits that `cut_visits` makes of the same rows.

    A run is open until a pose comes more than `gap_s` after its last sighting. One that has closed stays in use: a late
    sighting changes it, it does not take it away.
    """

    def __init__(self, gap_s: float, min_count: int = 1) -> None:
        if not (math.isfinite(gap_s) and gap_s > 0.0):
            raise SightingError(f"gap_s is {gap_s}; expected the longest pause inside a visit, above zero, in seconds.")
        if min_count < 1:
            raise SightingError(
                f"min_count is {min_count}; expected the least number of sightings of a visit, 1 or more."
            )
        self._gap_s, self._min_count = gap_s, min_count
        self._runs: dict[str, list[Run]] = {}
        self._changed: list[Run] = []
        self._table: Sightings | None = None
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def push(self, sightings: Sightings) -> None:
        """Add checked sightings."""
        first = self._n
        self._table = _appended(self._table, first, sightings)
        self._n += len(sightings)
        for i in range(len(sightings)):
            self._add(first + i, str(sightings.marker[i]), float(sightings.stamp_s[i]))

    def _add(self, row: int, marker: str, stamp_s: float) -> None:
        """A sighting joins the runs that it touches, and makes them one."""
        runs = self._runs.setdefault(marker, [])
        joined = Run(marker, [row], stamp_s, stamp_s)
        for run in [run for run in runs if self._touches(run, stamp_s)]:
            runs.remove(run)
            if run in self._changed:
                self._changed.remove(run)
            run.rows.extend(joined.rows)
            start_s, end_s = min(joined.start_s, run.start_s), max(joined.end_s, run.end_s)
            joined = Run(marker, run.rows, start_s, end_s, joined.used or run.used)
        runs.append(joined)
        self._changed.append(joined)

    def _touches(self, run: Run, stamp_s: float) -> bool:
        # The very differences that `cut_visits` compares.
        return not (stamp_s - run.end_s > self._gap_s or run.start_s - stamp_s > self._gap_s)

    def close(self, now_s: float) -> int:
        """Close the runs that can have ended by `now_s`; how many visits in use that makes or changes."""
        due = [run for run in self._changed if run.used or now_s - run.end_s > self._gap_s]
        if due:
            self._changed = [run for run in self._changed if run not in due]
        for run in due:
            run.used = True
        return sum(len(run.rows) >= self._min_count for run in due)

    @property
    def open_count(self) -> int:
        """Runs that have not ended."""
        return sum(not run.used for run in self._changed)

    def visits(self) -> list[Visit]:
        """The visits in use in the order of `cut_visits`, their rows in time order."""
        used = [run for runs in self._runs.values() for run in runs if run.used and len(run.rows) >= self._min_count]
        return sorted((self._visit(run) for run in used), key=lambda visit: (visit.start_s, visit.marker))

    def _visit(self, run: Run) -> Visit:
        if run.visit is None:
            rows = np.array(sorted(run.rows))
            rows = rows[np.argsort(self.stamp_s(rows), kind="stable")]
            run.visit = Visit(marker=run.marker, sightings=rows, start_s=run.start_s, end_s=run.end_s)
        return run.visit

    def stamp_s(self, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
        """Stamps of some sightings, by the order in which they came."""
        assert self._table is not None
        return self._table.stamp_s[rows]

    def sightings(self, rows: Int[np.ndarray, "m"]) -> Sightings:
        """Some of the sightings, by the order in which they came."""
        assert self._table is not None
        return self._table.take(rows)


def _appended(table: Sightings | None, n: int, more: Sightings) -> Sightings:
    """The table with room for twice its rows whenever it is full, so that adding costs the same on average."""
    need = n + len(more)
    names = [field.name for field in dataclasses.fields(Sightings)]
    if table is None or need > len(table):
        room = max(2 * need, _FIRST_ROOM)
        wider = {name: _room(getattr(more, name), room) for name in names}
        if table is not None:
            for name in names:
                wider[name][:n] = getattr(table, name)[:n]
        table = Sightings(**wider)
    for name in names:
        getattr(table, name)[n:need] = getattr(more, name)
    return table


def _room(column: np.ndarray, n: int) -> np.ndarray:
    """Names are kept as objects: a longer one must not be cut to the width of the first."""
    return np.empty((n, *column.shape[1:]), dtype=object if column.dtype.kind in "US" else column.dtype)
