"""Scan Context: what a place looks like from above, compared at every heading.

Kim & Kim, "Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D Point Cloud Map", IROS 2018: the
greatest height in each bin of a polar grid about the sensor (eqs. 1-3), the mean cosine distance of its columns at the
best turn (eqs. 6-7), and a key that turning does not change, for the search. Written from the paper.

Here it is made of submaps, not of single scans, and heights count from the submap's own low points, since the height of
the sensor above ground is not known.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

RINGS, SECTORS = 20, 60
_LOW_PERCENTILE = 2.0


@dataclasses.dataclass(frozen=True)
class ScanContexts:
    """Descriptors of k places.

    Attributes:
        context_m: (k, rings, sectors) greatest heights; 0 where nothing was seen.
        ring_key: (k, rings) mean of every ring, the same at every heading.
    """

    context_m: Float[np.ndarray, "k rings sectors"]
    ring_key: Float[np.ndarray, "k rings"]

    def __len__(self) -> int:
        return len(self.context_m)


def scan_context(level_m: Float[np.ndarray, "n 3"], radius_m: float) -> Float[np.ndarray, "rings sectors"]:
    """The descriptor of a cloud about its origin, z up; points beyond the radius do not count."""
    context = np.zeros((RINGS, SECTORS))
    distance = np.hypot(level_m[:, 0], level_m[:, 1])
    inside = (distance < radius_m) & (distance > 0.0)
    if not inside.any():
        return context
    points, distance = level_m[inside], distance[inside]
    ring = np.minimum((distance / radius_m * RINGS).astype(int), RINGS - 1)
    heading = np.arctan2(points[:, 1], points[:, 0])
    sector = np.floor((heading + np.pi) / (2.0 * np.pi) * SECTORS).astype(int) % SECTORS
    height = np.maximum(points[:, 2] - np.percentile(points[:, 2], _LOW_PERCENTILE), 1e-3)
    np.maximum.at(context, (ring, sector), height)
    return context


def scan_contexts(contexts_m: list[Float[np.ndarray, "rings sectors"]]) -> ScanContexts:
    """Descriptors with their ring keys."""
    context = np.stack(contexts_m)
    return ScanContexts(context, context.mean(axis=2))


def context_distance(
    first: Float[np.ndarray, "rings sectors"], second: Float[np.ndarray, "rings sectors"]
) -> tuple[float, float]:
    """(distance 0 .. 1, yaw in radians that turns the second onto the first): the best of all turns by whole sectors.

    Columns that are empty in either do not count, and a turn counts only with a quarter of the columns.
    """
    norm_a, norm_b = np.linalg.norm(first, axis=0), np.linalg.norm(second, axis=0)
    a = first / np.where(norm_a > 0.0, norm_a, 1.0)
    b = second / np.where(norm_b > 0.0, norm_b, 1.0)
    column = np.arange(SECTORS)
    turned = (column[None, :] - column[:, None]) % SECTORS  # [turn, column of the first] -> column of the second
    both = ((norm_a > 0.0)[None, :] & (norm_b > 0.0)[turned]).sum(axis=1)
    similarity = (a.T @ b)[column[None, :], turned].sum(axis=1)
    distance = np.where(both >= SECTORS // 4, 1.0 - similarity / np.maximum(both, 1), 1.0)
    turn = int(np.argmin(distance))
    yaw = 2.0 * np.pi * turn / SECTORS
    return float(distance[turn]), float((yaw + np.pi) % (2.0 * np.pi) - np.pi)
