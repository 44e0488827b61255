"""Corners to a few hundredths of a pixel: a line through the gradients of every side, and where two lines meet.

A corner found by thresholding is off by half a pixel, and one refined in its own small window knows little of the
sides. Here each side is crossed by short profiles; the edge on each is the gradient's centre of mass, a line is fitted
to these, and neighbouring lines meet in the corner. The scatter about the lines says how well the corners are known.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Num

from jaxgeo.detect.reading import remap

# Profiles leave out the rounded ends of a side; they reach a cell's width or so to both sides, no next edge inside.
_ENDS = 0.08
_REACH_CELLS = 0.8
_REACH_PX = (1.5, 6.0)
# Half a pixel, on long profiles more: their edges are no sharper.
_STEP_PX = 0.5
_MOST_STEPS = 15
_PROFILES = (12, 40)
_ROUNDS = 3
# An edge further from the line than this many pixels counts half: a leaf, a fold, a bright stone.
_OUTLIER_PX = 0.5
# Scatter of a side is pooled with that of the other three as if it had been seen so many times.
_POOLED = 20.0
# What lines do not show: the camera's sampling and sharpening, the print's own edges.
FLOOR_PX = 0.02

_NEXT, _PREVIOUS = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])


class Corners(NamedTuple):
    """Refined quadrilaterals.

    Attributes:
        corners_px: (q, 4, 2) in the order given.
        covariance_px2: (q, 8, 8) of (u0, v0, u1, v1, ..).
        ok: (q,) False where a side has no edge or the lines run away from the start; the start is kept there.
    """

    corners_px: Float[np.ndarray, "q 4 2"]
    covariance_px2: Float[np.ndarray, "q 8 8"]
    ok: Bool[np.ndarray, "q"]


def refine_corners(
    image: Num[np.ndarray, "h w"],
    quads_px: Float[np.ndarray, "q 4 2"],
    cells: int,
    *,
    dark_inside: bool = True,
    rounds: int = 3,
) -> Corners:
    """Corners from lines through the gradients of the sides.

    Args:
        image: bytes, or float32.
        quads_px: corners clockwise as seen in the image, within about a cell of the truth.
        cells: inner cells along a side.
        dark_inside: the border is darker than what is around it.
        rounds: how often the sides are followed, each time from the corners of the last.
    """
    start = np.asarray(quads_px, dtype=np.float64)
    cell_px = _cell_px(start, cells)
    farthest = 1.5 * cell_px + 1.0
    corners, usable = start, np.ones(len(start), dtype=bool)
    for _ in range(rounds):
        chord = corners[:, _NEXT] - corners
        length = np.maximum(np.sqrt(chord[..., 0] ** 2 + chord[..., 1] ** 2), 1e-9)
        normal = np.empty_like(chord)
        normal[..., 0], normal[..., 1] = chord[..., 1] / length, -chord[..., 0] / length
        offset, weight, along = _edge_offsets(image, corners, chord, normal, length, cell_px, dark_inside)
        sides = _fit(offset, weight, along)
        moved, solve = _meet(corners, normal, sides.line)
        distance = np.abs(moved - start).max(axis=(1, 2))
        usable &= (distance < farthest) & (weight.max(axis=2).min(axis=1) > 0.0)  # False for NaN too
        corners = np.where(usable[:, None, None], moved, start)
    covariance = np.where(usable[:, None, None], _corner_covariance(sides, solve), np.eye(8))
    return Corners(corners_px=corners, covariance_px2=covariance, ok=usable)


class _Sides(NamedTuple):
    """Lines along the sides: offset a + b (s - 1/2) outwards, s from 0 to 1; sums of what they were fitted to."""

    line: Float[np.ndarray, "q 4 2"]
    moments: Float[np.ndarray, "q 4 3"]
    determinant: Float[np.ndarray, "q 4"]
    squares: Float[np.ndarray, "q 4 3"]
    scatter: Float[np.ndarray, "q 4"]


def _cell_px(quads_px: Float[np.ndarray, "q 4 2"], cells: int) -> Float[np.ndarray, "q"]:
    sides = np.linalg.norm(quads_px[:, _NEXT] - quads_px, axis=2)
    return sides.min(axis=1) / (cells + 2)


def _edge_offsets(
    image: Num[np.ndarray, "h w"],
    corners: Float[np.ndarray, "q 4 2"],
    chord: Float[np.ndarray, "q 4 2"],
    normal: Float[np.ndarray, "q 4 2"],
    length: Float[np.ndarray, "q 4"],
    cell_px: Float[np.ndarray, "q"],
    dark_inside: bool,
) -> tuple[Float[np.ndarray, "q 4 p"], Float[np.ndarray, "q 4 p"], Float[np.ndarray, "p"]]:
    """Where the edge crosses each profile (pixels outwards from the side), its weight, and where along the side."""
    profiles = int(min(max(np.median(length), _PROFILES[0]), _PROFILES[1])) if len(length) else _PROFILES[0]
    along = _ENDS + (1.0 - 2.0 * _ENDS) / (profiles - 1) * np.arange(profiles)
    reach = np.minimum(np.maximum(_REACH_CELLS * cell_px, _REACH_PX[0]), _REACH_PX[1])
    steps = min(2 * int(np.ceil(reach.max(initial=_REACH_PX[0]) / _STEP_PX)) + 1, _MOST_STEPS)
    depth = (2.0 / (steps - 1) * np.arange(steps) - 1.0) * reach[:, None]
    at = corners[:, :, None] + along[:, None] * chord[:, :, None]
    points = at[:, :, :, None] + depth[:, None, None, :, None] * normal[:, :, None, None]
    levels = remap(image, points.reshape(len(corners), -1, 2).astype(np.float32))
    levels = levels.reshape(*points.shape[:-1]).astype(np.float32, copy=False)
    rise = levels[..., 1:] - levels[..., :-1] if dark_inside else levels[..., :-1] - levels[..., 1:]
    rise = np.maximum(rise, 0.0) ** 2
    middle = (depth[:, 1:] + depth[:, :-1]) / 2
    strength = rise.sum(axis=3, dtype=np.float64)
    offset = (rise * middle[:, None, None]).sum(axis=3) / np.maximum(strength, 1e-9)
    return offset, np.sqrt(strength), along


def _fit(
    offset: Float[np.ndarray, "q 4 p"], weight: Float[np.ndarray, "q 4 p"], along: Float[np.ndarray, "p"]
) -> _Sides:
    """Robust weighted lines (Cauchy weights, two re-weightings)."""
    x = along - 0.5
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    base = weight / np.maximum(weight.max(axis=2, keepdims=True), 1e-9)
    robust = base
    for last in (False, False, True):
        moments = robust @ powers
        determinant = np.maximum(moments[..., 0] * moments[..., 2] - moments[..., 1] ** 2, 1e-12)
        right = (robust * offset) @ powers[:, :2]
        a = (moments[..., 2] * right[..., 0] - moments[..., 1] * right[..., 1]) / determinant
        b = (moments[..., 0] * right[..., 1] - moments[..., 1] * right[..., 0]) / determinant
        residual = offset - a[..., None] - b[..., None] * x
        if not last:
            robust = base / (1.0 + (residual / _OUTLIER_PX) ** 2)
    freedom = np.maximum(moments[..., 0] - 2.0, 1.0)
    scatter = (robust * residual**2).sum(axis=2) / freedom
    scatter = (freedom * scatter + _POOLED * scatter.mean(axis=1, keepdims=True)) / (freedom + _POOLED)
    return _Sides(np.stack([a, b], axis=-1), moments, determinant, robust**2 @ powers, scatter)


def _meet(
    corners: Float[np.ndarray, "q 4 2"], normal: Float[np.ndarray, "q 4 2"], line: Float[np.ndarray, "q 4 2"]
) -> tuple[Float[np.ndarray, "q 4 2"], Float[np.ndarray, "q 4 2 2"]]:
    """Where neighbouring sides meet, and the derivative of corner i by the offsets there of sides i - 1 and i.

    Side i runs from corner i to corner i + 1, moved outwards by a - b/2 at its start and a + b/2 at its end: with unit
    normal n, n . x = n . corner + offset there. Corner i solves the equations of sides i - 1 (at its end) and i (at
    its start); turning a side moves its normal too, which for small b is second order and gone after a few rounds.
    """
    before = normal[:, _PREVIOUS]
    determinant = before[..., 0] * normal[..., 1] - before[..., 1] * normal[..., 0]
    determinant = np.where(np.abs(determinant) < 1e-6, np.nan, determinant)
    solve = np.empty((*determinant.shape, 2, 2))
    solve[..., 0, 0], solve[..., 0, 1] = normal[..., 1] / determinant, -before[..., 1] / determinant
    solve[..., 1, 0], solve[..., 1, 1] = -normal[..., 0] / determinant, before[..., 0] / determinant
    end = (line[..., 0] + 0.5 * line[..., 1])[:, _PREVIOUS]
    start = line[..., 0] - 0.5 * line[..., 1]
    return corners + solve[..., 0] * end[..., None] + solve[..., 1] * start[..., None], solve


def _corner_covariance(sides: _Sides, solve: Float[np.ndarray, "q 4 2 2"]) -> Float[np.ndarray, "q 8 8"]:
    """Of all corners from the scatter about the sides; a side joins its two corners."""
    q = len(solve)
    inverse = np.empty((q, 4, 2, 2))
    inverse[..., 0, 0], inverse[..., 1, 1] = sides.moments[..., 2], sides.moments[..., 0]
    inverse[..., 0, 1] = inverse[..., 1, 0] = -sides.moments[..., 1]
    inverse /= sides.determinant[..., None, None]
    # Sandwich: weights are not inverse variances, so the scatter of the weighted points goes through them.
    middle = sides.squares[..., [0, 1, 1, 2]].reshape(q, 4, 2, 2)
    line = sides.scatter[..., None, None] * (inverse @ middle @ inverse)
    jacobian = np.zeros((q, 4, 2, 4, 2))
    for corner, previous in enumerate(_PREVIOUS):
        jacobian[:, corner, :, previous] = solve[:, corner, :, :1] * np.array([1.0, 0.5])
        jacobian[:, corner, :, corner] = solve[:, corner, :, 1:] * np.array([1.0, -0.5])
    jacobian = jacobian.reshape(q, 8, 4, 2)
    through = np.einsum("qisa,qsab,qjsb->qij", jacobian, line, jacobian)
    return through + FLOOR_PX**2 * np.eye(8)
