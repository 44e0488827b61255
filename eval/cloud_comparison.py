"""Two clouds, each georeferenced on its own, against each other: distances both ways, their histogram and their map."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from eval.clouds import CloudDistance, checked_cloud, summary_of

# Points queried at once: their distances and neighbours fit into a few hundred megabytes.
_BLOCK = 2_000_000
PERCENT = (5.0, 25.0, 50.0, 75.0, 90.0, 95.0)


@dataclasses.dataclass(frozen=True)
class CloudComparison:
    """Distances in metres from every point of one cloud to the nearest of the other, both ways."""

    a_to_b_m: Float[np.ndarray, "n"]
    b_to_a_m: Float[np.ndarray, "m"]

    @property
    def a_to_b(self) -> CloudDistance:
        return summary_of(self.a_to_b_m)

    @property
    def b_to_a(self) -> CloudDistance:
        return summary_of(self.b_to_a_m)


@dataclasses.dataclass(frozen=True)
class DistanceMap:
    """Distances over a plan view.

    Attributes:
        median_m: (rows, columns) median of the distances in each cell, row 0 in the south; NaN where no point is.
        low_m: (2,) easting and northing of the lower left corner.
        cell_m: side of a cell.
    """

    median_m: Float[np.ndarray, "r c"]
    low_m: Float[np.ndarray, "2"]
    cell_m: float


def compare_clouds(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "m 3"]) -> CloudComparison:
    """Compare two clouds of one frame, metres; nothing is fitted between them.

    Raises:
        InputError: an empty cloud, one that is not (n, 3), or coordinates that are not finite.
    """
    checked_cloud("the first", a)
    checked_cloud("the second", b)
    return CloudComparison(_distances(a, KDTree(b)), _distances(b, KDTree(a)))


def distance_map(points_m: Float[np.ndarray, "n 3"], distance_m: Float[np.ndarray, "n"], cell_m: float) -> DistanceMap:
    """The median distance of the points in each cell of a plan view."""
    low = np.floor(points_m[:, :2].min(axis=0) / cell_m) * cell_m
    column, row = ((points_m[:, :2] - low) / cell_m).astype(np.int64).T
    columns, rows = int(column.max()) + 1, int(row.max()) + 1
    cell = row * columns + column
    order = np.lexsort((distance_m, cell))
    first, count = _runs(cell[order])
    # Sorted within a cell: the middle one, or the mean of the middle two
    upper, lower = distance_m[order[first + count // 2]], distance_m[order[first + (count - 1) // 2]]
    median = np.full(rows * columns, np.nan)
    median[cell[order[first]]] = 0.5 * (upper + lower)
    return DistanceMap(median.reshape(rows, columns), low, cell_m)


def thinned(points_m: Float[np.ndarray, "n 3"], voxel_m: float) -> Int[np.ndarray, "m"]:
    """Rows of one point a voxel, the first of each; in order."""
    key = np.floor(points_m / voxel_m).astype(np.int64)
    key -= key.min(axis=0)
    span = key.max(axis=0) + 1
    flat = (key[:, 0] * span[1] + key[:, 1]) * span[2] + key[:, 2]
    return np.sort(np.unique(flat, return_index=True)[1])


def _distances(points_m: Float[np.ndarray, "n 3"], tree: KDTree) -> Float[np.ndarray, "n"]:
    blocks = [tree.query(points_m[i : i + _BLOCK], workers=-1)[0] for i in range(0, len(points_m), _BLOCK)]
    return np.concatenate(blocks)


def _runs(sorted_values: Int[np.ndarray, "n"]) -> tuple[Int[np.ndarray, "g"], Int[np.ndarray, "g"]]:
    """Where each run of equal values begins, and how long it is."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(sorted_values) > 0]))
    return first, np.diff(np.concatenate([first, [len(sorted_values)]]))
