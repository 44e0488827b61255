"""Visits: runs of sightings of one marker."""

import dataclasses

import numpy as np
from jaxtyping import Int


@dataclasses.dataclass(frozen=True)
class Visit:
    """A run of sightings of one marker with no gap longer than `gap_s`.

    Attributes:
        marker: decoded id; empty where unknown.
        sightings: rows of the `Sightings` it was cut from, in time order.
        start_s, end_s: stamps of its first and last sighting.
        location: name of the surveyed location it was tied to; empty before labelling.
        label: its own name, unique in the session: the location's, with `_revisit`, `_revisit2` … for later visits.
    """

    marker: str
    sightings: Int[np.ndarray, "m"]
    start_s: float
    end_s: float
    location: str = ""
    label: str = ""

    @property
    def count(self) -> int:
        return len(self.sightings)
