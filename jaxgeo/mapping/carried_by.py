"""By what the points of a cloud find the pose that saw them: stamps, pose indices, or the way to the path."""

import dataclasses
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool

from jaxgeo.errors import CloudError
from jaxgeo.io.clouds.chunk import CloudChunk
from jaxgeo.io.clouds.source import CHUNK, CloudSource
from jaxgeo.mapping.carry import Place, PoseCorrections, default_hold_s, places_by_index, places_by_stamp

By = Literal["stamp", "index", "nearest"]
BY = get_args(By)
_COLUMN: dict[By, str] = {"stamp": "stamp_s", "index": "pose_index"}
_MOST = 0.5  # of the points must have a pose, for a column to be believed unasked
_STAMP_STEPS = 4  # a stamp must be at least so much finer than the poses are apart


@dataclasses.dataclass(frozen=True)
class Chosen:
    """How a cloud is carried.

    Attributes:
        by: what its points are placed by.
        why: in words.
        n_outside: points that no pose saw, by their column; 0 for `nearest`.
        hold_s: how long before the first and after the last pose its correction holds.
    """

    by: By
    why: str
    n_outside: int
    hold_s: float


def choose_by(
    source: CloudSource,
    corrections: PoseCorrections,
    by: By | None = None,
    hold_s: float | None = None,
    size: int = CHUNK,
) -> Chosen:
    """Look through the cloud's stamps and indices once, and say which of them lead to a pose.

    Args:
        by: what is asked for; None: stamps, where most lie within the trajectory, else pose indices, else the nearest
            poses.
        hold_s: as in `places_by_stamp`.

    Raises:
        CloudError: what is asked for is not in the cloud, leads nowhere, or the stamps are too coarse.
    """
    hold_s = default_hold_s(corrections) if hold_s is None else hold_s
    refused: list[str] = []
    tried: tuple[By, ...] = ("stamp", "index") if by is None else () if by == "nearest" else (by,)
    for each in tried:
        n_outside, problem, span = _survey(source, corrections, each, hold_s, size)
        if problem is None and (by is not None or n_outside <= (1.0 - _MOST) * source.n_points):
            return Chosen(each, f"its {span}", n_outside, hold_s)
        refused.append(problem or f"{n_outside:,} of its {source.n_points:,} points have no pose by {span}")
    if by in _COLUMN:
        raise CloudError(
            f"{source.path}: cannot be carried by {by}: {refused[0]}. Leave --by out, or try --by nearest."
        )
    why = "as asked for" if by == "nearest" else "; ".join(refused)
    return Chosen("nearest", f"the poses nearest to each point ({why})", 0, hold_s)


def place_finder(
    corrections: PoseCorrections, chosen: Chosen
) -> Callable[[CloudChunk], tuple[Place, Bool[np.ndarray, "n"]]]:
    """Where the points of a chunk were seen, by stamp or index, and which points any pose saw."""
    column = _COLUMN[chosen.by]
    return lambda chunk: _places(corrections, chosen.by, chunk.columns[column], chosen.hold_s)


def _places(
    corrections: PoseCorrections, by: By, values: np.ndarray, hold_s: float
) -> tuple[Place, Bool[np.ndarray, "n"]]:
    if by == "stamp":
        return places_by_stamp(corrections, values, hold_s)
    return places_by_index(corrections, values)


def _survey(
    source: CloudSource, corrections: PoseCorrections, by: By, hold_s: float, size: int
) -> tuple[int, str | None, str]:
    """Points outside, what speaks against the column altogether, and its range in words."""
    name = _COLUMN[by]
    if name not in source.columns:
        return 0, f"it has no {name}", ""
    if by == "index" and source.columns[name].kind not in "iu":
        return 0, f"its {name} is {source.columns[name]}, not a whole number", ""
    low, high, n_outside = np.inf, -np.inf, 0
    for values in source.column(name, size):
        n_outside += int((~_places(corrections, by, values, hold_s)[1]).sum())
        finite = values[np.isfinite(values)].astype(np.float64)
        low, high = min(low, finite.min(initial=np.inf)), max(high, finite.max(initial=-np.inf))
    if by == "stamp":
        first_s, last_s = corrections.stamp_s[[0, -1]]
        span = f"{name} {low:.6f} to {high:.6f} (trajectory: {first_s:.6f} to {last_s:.6f})"
        if np.isfinite(high) and (problem := _coarse(source.columns[name], high, corrections)):
            return n_outside, problem, span
    else:
        span = f"{name} {low:.0f} to {high:.0f} (trajectory: {len(corrections.before_stamp_s)} poses)"
    problem = f"no pose saw any of its points by {span}" if n_outside == source.n_points else None
    return n_outside, problem, span


def _coarse(kind: np.dtype, largest: float, corrections: PoseCorrections) -> str | None:
    if kind.kind != "f":
        return None
    step_s = float(np.spacing(kind.type(largest)))
    poses_s = float(np.median(np.diff(corrections.stamp_s)))
    if step_s * _STAMP_STEPS <= poses_s:
        return None
    return f"its stamps, {kind} at {largest:.6g} s, come in steps of {step_s:g} s, the poses every {poses_s:.3g} s"
