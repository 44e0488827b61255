"""Corners from every edge of a decoded marker: where black cells meet white ones, inside and all round.

The four sides alone are at the mercy of what lies behind the marker, and blur draws each of them towards the next edge
inside. Once the code is known so are some eighty short edges of both directions and both signs: a homography fitted to
all of them averages the surroundings and most of the blur out, and their scatter tells how well it is known.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Num

from jaxgeo.data import Camera
from jaxgeo.detect.edges import Corners
from jaxgeo.detect.lens import bent, flattened
from jaxgeo.detect.reading import remap, unit_homographies

_MOST_ROUNDS, _SETTLED_PX = 4, 0.25
# Profiles reach this part of a cell to both sides: the next edge may be a cell away.
_REACH_CELLS = 0.6
_REACH_PX = (1.0, 4.0)
_STEPS = 13
# Along an edge its middle part is averaged.
_ALONG = (0.2, 0.8)
_MOST_ALONG = 5
# An edge further off than this many times the median one counts half.
_OUTLIER = 2.0
# Edges within three spreads (or this) of the fit; a fit with fewer of them has caught on something else.
_AGREE_PX = 0.5
_LEAST_SHARE = 0.6
# What scatter does not show: sampling, sharpening, a print that is not flat; and, in markers whose cells are a few
# pixels wide, blur that draws neighbouring edges towards each other, which falls with the square of the width (fitted
# to simulated images of 20 to 200 px: errors squared over covariance came out half too large below 30 px without it).
FLOOR_PX = 0.016
NARROW_PX3 = 0.4


class CellEdges(NamedTuple):
    """Edges between a black and a white cell, in the marker's unit square.

    Attributes:
        middle: (e, 2); along: (e, 2) half the edge; outward: (e, 2) half a cell from black towards white.
    """

    middle: Float[np.ndarray, "e 2"]
    along: Float[np.ndarray, "e 2"]
    outward: Float[np.ndarray, "e 2"]


def cell_edges(white: Bool[np.ndarray, "r r"]) -> CellEdges:
    """Of a code as `white_cells` gives it: all edges between cells, the ring outside only against the border."""
    cell = 1.0 / (len(white) - 2)
    middle, along, outward = [], [], []
    for axis in (0, 1):  # edges between rows, between columns
        first, second = (white[:-1], white[1:]) if axis == 0 else (white[:, :-1], white[:, 1:])
        row, column = np.nonzero(first != second)
        sign = np.where(second[row, column], 1.0, -1.0)
        half = np.array([0.5, 0.0])
        at = np.stack([column, row], axis=1) - 1.0  # of the first cell's upper left, in cells
        middle.append(at + (np.array([0.5, 1.0]) if axis == 0 else np.array([1.0, 0.5])))
        along.append(np.broadcast_to(half if axis == 0 else half[::-1], at.shape))
        outward.append(sign[:, None] * (half[::-1] if axis == 0 else half))
    return CellEdges(*(cell * np.concatenate(part) for part in (middle, along, outward)))


@functools.lru_cache(maxsize=4096)
def _edges_of(cells: int, white: bytes) -> CellEdges:
    return cell_edges(np.frombuffer(white, dtype=bool).reshape(cells, cells))


def refine_with_code(
    image: Num[np.ndarray, "h w"],
    quad_px: Float[np.ndarray, "4 2"],
    white: Bool[np.ndarray, "r r"],
    camera: Camera | None = None,
) -> Corners:
    """Corners of one decoded marker from all its edges (q = 1).

    Each edge gives one number: how far the gradient's centre of mass lies off. The homography is fitted by Gauss-Newton
    with Cauchy weights; its covariance is scatter^2 (J^T W J)^-1 of one observation an edge, so that what neighbouring
    pixels of an edge share does not count twice.

    Args:
        image: bytes or float32; black is dark.
        quad_px: corners clockwise as seen, to half a cell.
        white: the cells in the frame of that quad.
        camera: whose lens bends the marker's edges; None: straight ones.
    """
    edges = _edges_of(white.shape[0], white.tobytes())
    start = np.asarray(quad_px, dtype=np.float64)
    unchanged = Corners(start[None], np.eye(8)[None], np.array([False]))
    cell_px = np.linalg.norm(np.roll(start, -1, axis=0) - start, axis=1).min() / (len(white) - 2)
    farthest = 0.7 * cell_px + 0.5
    flat, reached = flattened(start, camera)
    if len(edges.middle) <= 12 or not np.all(reached):
        return unchanged
    begun, homography = flat, unit_homographies(flat[None])[0]
    homography /= homography[2, 2]
    for _ in range(_MOST_ROUNDS):
        step, covariance, share = _solve(*_observe(image, homography, edges, cell_px, camera))
        homography.ravel()[:8] += step[:8]
        before, (flat, corner) = flat, _by_entries(homography, _UNIT)
        if not np.abs(flat - begun).max() < farthest:  # so for NaN too
            return unchanged
        if np.abs(flat - before).max() < _SETTLED_PX:
            break
    if share < _LEAST_SHARE:
        return unchanged
    corners, by_flat = bent(flat, camera)
    through = (by_flat @ corner).reshape(8, 8)
    covariance = through @ covariance[:8, :8] @ through.T + (FLOOR_PX**2 + (NARROW_PX3 / cell_px**2) ** 2) * np.eye(8)
    return Corners(corners[None], covariance[None], np.array([True]))


_UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def _by_entries(
    homography: Float[np.ndarray, "3 3"], at: Float[np.ndarray, "k 2"]
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2 8"]]:
    """Mapped points, and their derivative by the first eight entries (the ninth is 1)."""
    u, v = at.T
    x, y, w = homography @ np.stack([u, v, np.ones_like(u)])
    x, y = x / w, y / w
    derivative = np.zeros((len(at), 2, 8))
    derivative[:, 0, 0], derivative[:, 0, 1], derivative[:, 0, 2] = u / w, v / w, 1.0 / w
    derivative[:, 1, 3:6] = derivative[:, 0, :3]
    derivative[:, 0, 6], derivative[:, 0, 7] = -x * u / w, -x * v / w
    derivative[:, 1, 6], derivative[:, 1, 7] = -y * u / w, -y * v / w
    return np.stack([x, y], axis=1), derivative


def _observe(
    image: Num[np.ndarray, "h w"],
    homography: Float[np.ndarray, "3 3"],
    edges: CellEdges,
    cell_px: float,
    camera: Camera | None,
) -> tuple[Float[np.ndarray, "e"], Float[np.ndarray, "e"], Float[np.ndarray, "e 9"]]:
    """Offset of each edge across itself (pixels), its strength, and the derivative by the unknowns: the homography's
    entries, and one shift of all edges towards white (light that spills over, ink that spreads, blur in narrow lines).
    """
    middle, derivative = _by_entries(homography, edges.middle)
    if camera is not None:
        middle, by_flat = bent(middle, camera)
        derivative = by_flat @ derivative
    linear = derivative @ _entries_by_point(homography)
    tangent = (linear @ edges.along[:, :, None])[..., 0]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    normal /= np.maximum(np.sqrt((normal**2).sum(axis=1, keepdims=True)), 1e-9)
    facing = (normal * (linear @ edges.outward[:, :, None])[..., 0]).sum(axis=1)
    normal *= np.where(facing < 0.0, -1.0, 1.0)[:, None]
    reach = min(max(_REACH_CELLS * cell_px, _REACH_PX[0]), _REACH_PX[1])
    depth = np.linspace(-reach, reach, _STEPS)
    count = int(min(max(round(cell_px * (_ALONG[1] - _ALONG[0])), 2), _MOST_ALONG))
    along = 2.0 * np.linspace(*_ALONG, count) - 1.0
    at = middle[:, None] + along[:, None] * tangent[:, None]
    points = at[:, :, None] + depth[:, None] * normal[:, None, None]
    levels = remap(image, points.reshape(1, -1, 2).astype(np.float32)).reshape(points.shape[:-1])
    profile = levels.mean(axis=1, dtype=np.float64)
    rise = np.maximum(profile[:, 1:] - profile[:, :-1], 0.0) ** 2
    strength = rise.sum(axis=1)
    offset = rise @ ((depth[1:] + depth[:-1]) / 2) / np.maximum(strength, 1e-9)
    by_entries = (normal[:, None] @ derivative)[:, 0]
    return offset, np.sqrt(strength), np.concatenate([by_entries, np.ones((len(offset), 1))], axis=1)


def _entries_by_point(homography: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "8 2"]:
    """Moving the point by (du, dv) moves its image as these changes of the entries do: H (p + d) = (H + dH) p."""
    change = np.zeros((3, 3, 2))
    change[:, 2] = homography[:, :2]
    # The ninth entry stays 1: the whole is divided by 1 + its change.
    change -= homography[:, :, None] * change[2, 2]
    return change.reshape(9, 2)[:8]


def _middle(values: Float[np.ndarray, "e"]) -> float:
    """The upper median; np.median takes five times as long on so few."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _solve(
    offset: Float[np.ndarray, "e"], strength: Float[np.ndarray, "e"], design: Float[np.ndarray, "e k"]
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k k"], float]:
    """Robust weighted step of the unknowns, its covariance, and the share of edges that lie where they should."""
    scale = np.maximum(np.sqrt((design**2).sum(axis=0)), 1e-12)
    unit = design / scale
    base = np.minimum(strength / max(_middle(strength), 1e-9), 1.0)
    weight, ridge = base, 1e-9 * np.eye(len(scale))
    for last in (False, False, True):
        weighted = unit * weight[:, None]
        inverse = np.linalg.inv(weighted.T @ unit + ridge)
        step = inverse @ (offset @ weighted)
        residual = offset - unit @ step
        spread = 1.4826 * _middle(np.abs(residual)) + 1e-3
        if not last:
            weight = base / (1.0 + (residual / (_OUTLIER * spread)) ** 2)
    freedom = max(float(weight.sum()) - len(scale), 1.0)
    scatter = float(weight @ residual**2) / freedom
    covariance = scatter * inverse @ (weighted.T @ weighted) @ inverse
    agreeing = np.mean(np.abs(residual) < max(3.0 * spread, _AGREE_PX))
    return step / scale, covariance / scale[:, None] / scale, float(agreeing)
