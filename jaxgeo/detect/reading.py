"""The code inside a quadrilateral: sampled cells, set against the border's black and the surroundings' white."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Num

from jaxgeo.detect.families import Family, pack

# Where in a cell it is sampled: the middle, three by three, so that neighbours stay out under blur.
_IN_CELL = np.array([0.25, 0.5, 0.75])
# Small markers blur into their neighbours: a second reading takes this much of the Laplacian of the cells away.
_SHARPENING = 0.25
# Half a turn's corner order UL, UR, LR, LL -> lower left, lower right, upper right, upper left.
_COUNTER_CLOCKWISE = np.array([3, 2, 1, 0])


class Readings(NamedTuple):
    """The best reading of each quadrilateral in one group of families with as many cells.

    Attributes:
        family: (q,) index into the families given.
        marker: (q,) id.
        hamming: (q,) bits that differ from the id's code.
        quarter_turns: (q,) of the print against the quadrilateral's first corner, counter-clockwise.
        margin: (q,) mean distance of the cells from the threshold: 0 none, 1 all of them black or white.
        border_errors: (q,) share of the border's cells that are not black.
        contrast: (q,) white less black, gray levels.
    """

    family: Int[np.ndarray, "q"]
    marker: Int[np.ndarray, "q"]
    hamming: Int[np.ndarray, "q"]
    quarter_turns: Int[np.ndarray, "q"]
    margin: Float[np.ndarray, "q"]
    border_errors: Float[np.ndarray, "q"]
    contrast: Float[np.ndarray, "q"]


def read_codes(
    gray: Num[np.ndarray, "h w"], quads_px: Float[np.ndarray, "q 4 2"], families: Sequence[Family]
) -> Readings:
    """The best reading of each quadrilateral among families that have as many cells.

    White and black are planes over the marker (light is seldom even), fitted to the ring around it and to its border.
    Where the surroundings are not white, the middle between the darkest and brightest inner cells is tried too; each
    threshold with and without sharpening. The reading with the fewest corrected bits wins.

    Args:
        gray: bytes, or float32.
        quads_px: corners clockwise as seen in the image, any first.
        families: all with the same `cells`.
    """
    return read_cells(sample_cells(gray, quads_px, families[0].cells), families)


def read_cells(cells: Float[np.ndarray, "q r r"], families: Sequence[Family]) -> Readings:
    """`read_codes` of cells that are sampled already."""
    n = families[0].cells
    plain = _read(cells, n, families)
    if not np.any(plain.hamming):
        return plain
    sharp = _read(_sharpened(cells), n, families)
    return _choose((sharp.hamming < plain.hamming) | _clearer(sharp, plain), sharp, plain)


def sample_cells(
    image: Num[np.ndarray, "h w ..."], quads_px: Float[np.ndarray, "q 4 2"], cells: int
) -> Float[np.ndarray, "q r r ..."]:
    """Mean level of every cell: the inner ones, the border and one ring outside (r = cells + 4)."""
    return levels_at(image, cell_points(quads_px, cells), cells)


def cell_points(quads_px: Float[np.ndarray, "q 4 2"], cells: int) -> Float32[np.ndarray, "q k 2"]:
    """The pixels that `sample_cells` reads."""
    mapped = _grid(cells) @ np.swapaxes(unit_homographies(quads_px), 1, 2)
    depth = np.where(np.abs(mapped[..., 2:]) < 1e-9, 1e-9, mapped[..., 2:])
    return (mapped[..., :2] / depth).astype(np.float32)


def levels_at(
    image: Num[np.ndarray, "h w ..."], points: Float32[np.ndarray, "q k 2"], cells: int
) -> Float[np.ndarray, "q r r ..."]:
    """Mean levels of the cells whose `cell_points` these are."""
    r, k = cells + 4, len(_IN_CELL)
    levels = remap(image, points).reshape(len(points), r, k, r, k, *image.shape[2:])
    return levels.sum(axis=(2, 4), dtype=np.float64) / k**2


@functools.cache
def _grid(cells: int) -> Float[np.ndarray, "k 3"]:
    at = (np.arange(-1, cells + 3)[:, None] + _IN_CELL).ravel() / (cells + 2)
    return np.stack([*np.meshgrid(at, at), np.ones((len(at), len(at)))], axis=-1).reshape(-1, 3)


# OpenCV's remap counts an image's rows in 16 bits.
_REMAP_ROWS = 30_000


def remap(image: Num[np.ndarray, "h w ..."], points: Float[np.ndarray, "... 2"]) -> Num[np.ndarray, "..."]:
    """Bilinear levels at pixel positions (float32); outside the image those of its nearest pixel."""
    flat = points.reshape(-1, points.shape[-2], 2)
    none: Any = None  # both coordinates are in the first map
    parts = [
        cv2.remap(image, flat[i : i + _REMAP_ROWS], none, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for i in range(0, len(flat), _REMAP_ROWS)
    ]
    joined = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return joined.reshape(*points.shape[:-1], *image.shape[2:])


def unit_homographies(quads_px: Float[np.ndarray, "q 4 2"]) -> Float[np.ndarray, "q 3 3"]:
    """Homographies that take (0,0), (1,0), (1,1), (0,1) to the corners.

    Closed form (Heckbert, "Fundamentals of texture mapping and image warping", 1989, section 2.2.3).
    """
    p0, p1, p2, p3 = np.moveaxis(quads_px, 1, 0)
    d1, d2, s = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    denominator = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    denominator = np.where(np.abs(denominator) < 1e-12, 1e-12, denominator)
    g = (s[:, 0] * d2[:, 1] - s[:, 1] * d2[:, 0]) / denominator
    h = (d1[:, 0] * s[:, 1] - d1[:, 1] * s[:, 0]) / denominator
    first = p1 - p0 + g[:, None] * p1
    second = p3 - p0 + h[:, None] * p3
    last = np.stack([g, h, np.ones(len(g))], axis=1)
    return np.concatenate([np.stack([first, second, p0], axis=2), last[:, None]], axis=1)


def in_print_order(
    quads_px: Float[np.ndarray, "m 4 2"], quarter_turns: Int[np.ndarray, "m"]
) -> Float[np.ndarray, "m 4 2"]:
    """Corners lower left, lower right, upper right, upper left of the upright print."""
    index = (_COUNTER_CLOCKWISE - quarter_turns[:, None]) % 4
    return np.take_along_axis(quads_px, index[:, :, None], axis=1)


def covariance_in_print_order(
    covariance_px2: Float[np.ndarray, "m 8 8"], quarter_turns: Int[np.ndarray, "m"]
) -> Float[np.ndarray, "m 8 8"]:
    """The covariance of (u0, v0, u1, v1, ..) after `in_print_order`."""
    corner = (_COUNTER_CLOCKWISE - quarter_turns[:, None]) % 4
    index = (2 * corner[:, :, None] + np.arange(2)).reshape(-1, 8)
    rows = np.take_along_axis(covariance_px2, index[:, :, None], axis=1)
    return np.take_along_axis(rows, index[:, None, :], axis=2)


def _sharpened(cells: Float[np.ndarray, "q r r"]) -> Float[np.ndarray, "q r r"]:
    padded = np.pad(cells, ((0, 0), (1, 1), (1, 1)), mode="edge")
    around = padded[:, 2:, 1:-1] + padded[:, :-2, 1:-1] + padded[:, 1:-1, 2:] + padded[:, 1:-1, :-2]
    return cells - _SHARPENING * (around - 4.0 * cells)


def _read(levels: Float[np.ndarray, "q r r"], n: int, families: Sequence[Family]) -> Readings:
    outside, border = rings(n)
    white, black = _plane(levels, outside), _plane(levels, border)
    contrast = np.mean(white - black, axis=(1, 2))
    value = (levels - black) / np.maximum(white - black, 3.0)
    inner = value[:, 2:-2, 2:-2].reshape(len(levels), -1)
    middle = np.clip((inner.min(axis=1) + inner.max(axis=1)) / 2, 0.2, 0.8)
    best: Readings | None = None
    for threshold in (np.full(len(levels), 0.5), middle):
        code = pack(inner > threshold[:, None])
        family, marker, turns, hamming = _nearest(code, families)
        reading = Readings(
            family=family,
            marker=marker,
            hamming=hamming,
            quarter_turns=turns,
            margin=np.mean(np.clip(2.0 * np.abs(inner - threshold[:, None]), 0.0, 1.0), axis=1),
            border_errors=np.mean(value[:, border] > threshold[:, None], axis=1),
            contrast=contrast,
        )
        best = reading if best is None else _choose(reading.hamming < best.hamming, reading, best)
        if not np.any(best.hamming):
            break
    assert best is not None
    return best


def _clearer(first: Readings, second: Readings) -> Bool[np.ndarray, "q"]:
    return (first.hamming == second.hamming) & (first.margin > second.margin)


def _choose(first_wins: Bool[np.ndarray, "q"], first: Readings, second: Readings) -> Readings:
    return Readings(*(np.where(first_wins, a, b) for a, b in zip(first, second, strict=True)))


@functools.cache
def rings(n: int) -> tuple[Bool[np.ndarray, "r r"], Bool[np.ndarray, "r r"]]:
    """Of a marker of n by n cells as `sample_cells` gives it: the ring outside without its corners, and the border."""
    at = np.arange(n + 4)
    depth = np.minimum.reduce(
        np.broadcast_arrays(at[:, None], at[None, :], (n + 3 - at)[:, None], (n + 3 - at)[None, :])
    )
    corner = np.isin(at, (0, n + 3))
    return (depth == 0) & ~(corner[:, None] & corner[None, :]), depth == 1


def _plane(levels: Float[np.ndarray, "q r r"], cells: Bool[np.ndarray, "r r"]) -> Float[np.ndarray, "q r r"]:
    """Least-squares plane through some cells; the rings are symmetric, so its three terms part."""
    at = np.arange(levels.shape[1]) - (levels.shape[1] - 1) / 2
    row, column = np.nonzero(cells)
    chosen = levels[:, cells]
    down = chosen @ at[row] / np.sum(at[row] ** 2)
    along = chosen @ at[column] / np.sum(at[column] ** 2)
    return chosen.mean(axis=1)[:, None, None] + down[:, None, None] * at[:, None] + along[:, None, None] * at


def _nearest(code: np.ndarray, families: Sequence[Family]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Family, id, quarter turns and Hamming distance of the nearest code, for each."""
    found = []
    for f, one in enumerate(families):
        distance = np.bitwise_count(one.codes.reshape(-1) ^ code[:, None])
        at = np.argmin(distance, axis=1)
        found.append((np.full(len(code), f), at // 4, at % 4, distance[np.arange(len(code)), at].astype(np.int64)))
    stacked = [np.stack(column) for column in zip(*found, strict=True)]
    winner = np.argmin(stacked[3], axis=0)
    family, marker, turns, hamming = (column[winner, np.arange(len(code))] for column in stacked)
    return family, marker, turns, hamming
