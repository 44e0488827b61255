"""What a plan says: layouts side by side, what each promises along the path, and what would change it."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from eval.placement.criteria import Criterion

# How a layout was found: by gradient from many starts, one candidate after the other, by trying every choice of
# candidates, by exchanging one for another until none is better, at equal distances along the path, or given.
Method = Literal["gradient", "greedy", "exhaustive", "exchange", "equal spacing", "given"]
Change = Literal["one more", "one lost", "revisit", "better survey", "longer dwell"]


@dataclasses.dataclass(frozen=True)
class PlannedVisit:
    """A pass of the path by a marker: how far along the path, and how well the marker is seen from there (0 .. 1)."""

    location: str
    distance_m: float
    seen: float


@dataclasses.dataclass(frozen=True)
class PlannedLayout:
    """Markers and the accuracy they promise, in the local frame.

    Attributes:
        method: how it was found.
        name: (k,) of the markers; `standing` (k,) those that stand already.
        point_m: (k, 3).
        accuracy_m: of each criterion, see `criteria.criterion_m`.
        covariance_m2: (m, 3, 3) predicted, of the watched points of the path.
        visits: in the order of the path.
        seconds: the search took.
    """

    method: Method
    name: tuple[str, ...]
    standing: tuple[bool, ...]
    point_m: Float[np.ndarray, "k 3"]
    accuracy_m: dict[Criterion, float]
    covariance_m2: Float[np.ndarray, "m 3 3"]
    visits: tuple[PlannedVisit, ...]
    seconds: float


@dataclasses.dataclass(frozen=True)
class WhatIf:
    """One change of the chosen layout, and the criterion after it.

    Attributes:
        change: what; `marker` which one it is about, "" where none.
        point_m: (3,) where the additional marker would stand; None of other changes.
        further_m: additional way: to come back to a marker after the path's end.
        accuracy_m: the plan's criterion after the change; infinite where the frame would no longer be fixed.
    """

    change: Change
    marker: str
    point_m: Float[np.ndarray, "3"] | None
    further_m: float
    accuracy_m: float


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """Of the plan's criterion, in its relative change for a relative change of something: d log / d log.

    Attributes:
        survey_sigma, sighting_sigma: 1: the criterion grows as they do; 0: they do not matter.
        noise: by component of the odometry noise that is not zero (`jaxgeo.graph.components.COMPONENTS`).
        position_per_m: (k, 2) change of log criterion a metre of each marker's easting and northing.
    """

    survey_sigma: float
    sighting_sigma: float
    noise: dict[str, float]
    position_per_m: Float[np.ndarray, "k 2"]


@dataclasses.dataclass(frozen=True)
class PlacementAnswer:
    """For one number of markers.

    Attributes:
        criterion: what was made small.
        distance_m, position_m: (m,), (m, 3) of the watched points along the path.
        layouts: the chosen one first, then what it is compared with.
        what_if, sensitivity: of the chosen one.
        starts: searches by gradient; `starts_near_best` ended within a hundredth of the best.
    """

    criterion: Criterion
    distance_m: Float[np.ndarray, "m"]
    position_m: Float[np.ndarray, "m 3"]
    layouts: tuple[PlannedLayout, ...]
    what_if: tuple[WhatIf, ...]
    sensitivity: Sensitivity
    starts: int
    starts_near_best: int

    @property
    def chosen(self) -> PlannedLayout:
        return self.layouts[0]
