"""A plan, or the prediction of a given layout, with all that its files say about it."""

import dataclasses
import math
from typing import Any

import numpy as np
from jaxtyping import Float

from eval.placement.answer import PlacementAnswer, PlannedLayout
from eval.placement.planned import PlacementInput
from jaxgeo.data import Trajectory
from jaxgeo.export.figure_style import distance_along_m
from jaxgeo.georef import LocalFrame
from jaxgeo.io.orthophoto import Orthophoto


@dataclasses.dataclass(frozen=True)
class PlacementReport:
    """Local frame, metres.

    Attributes:
        path, path_said: the path, and where it is from in words.
        noise: of `PlacementInputs.noise_facts`: odometry, file, session, sets, sigma_median, ..
        given: what was possible and wanted.
        answers: one for every number of anchors; one of a prediction.
        predicted: a given layout was asked about, nothing was searched.
        config: resolved; `run` seeds, versions, input hashes, times.
        warnings: sentences for the user.
    """

    name: str
    simulated: bool
    frame: LocalFrame
    path: Trajectory
    path_said: str
    noise: dict[str, Any]
    given: PlacementInput
    answers: tuple[PlacementAnswer, ...]
    predicted: bool
    config: dict[str, Any]
    run: dict[str, Any]
    warnings: tuple[str, ...] = ()
    basemap: Orthophoto | None = None

    @property
    def path_length_m(self) -> float:
        return float(distance_along_m(self.path.position_m)[-1])


def count_of(layout: PlannedLayout) -> int:
    """Anchors that do not stand yet."""
    return sum(not stands for stands in layout.standing)


def layout_by(answer: PlacementAnswer, method: str) -> PlannedLayout | None:
    """The layout that this method found, if it was tried."""
    return next((layout for layout in answer.layouts if layout.method == method), None)


def gain(answer: PlacementAnswer, layout: PlannedLayout) -> float:
    """By which share of equal spacing's criterion a layout is better; NaN where there is nothing to compare."""
    even = layout_by(answer, "equal spacing")
    if even is None:
        return math.nan
    value, reference = layout.accuracy_m[answer.criterion], even.accuracy_m[answer.criterion]
    return 1.0 - value / reference if math.isfinite(value) and math.isfinite(reference) else math.nan


def sigma_along_m(answer: PlacementAnswer, layout: PlannedLayout) -> Float[np.ndarray, "m 4"]:
    """Predicted standard deviations at the watched points: E, N, h, and all axes together."""
    variance = np.diagonal(layout.covariance_m2, axis1=1, axis2=2)
    return np.sqrt(np.column_stack([variance, variance.sum(axis=1)]))


def visits_by_anchor(layout: PlannedLayout) -> dict[str, list[float]]:
    """How far along the path every anchor is passed; none where it is not seen."""
    passed: dict[str, list[float]] = {name: [] for name in layout.name}
    for visit in layout.visits:
        passed[visit.location].append(visit.distance_m)
    return passed
