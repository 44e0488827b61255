"""Sums over the points of each voxel and pass, gathered cloud by cloud in sorted arrays."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxgeo.errors import CloudError

_BITS = 21  # of a voxel's number along each axis: a million voxels to either side of the origin
_REACH = 1 << (_BITS - 1)
_MANY_ROWS = 500_000


@dataclasses.dataclass(frozen=True)
class VoxelRows:
    """A row a voxel and pass, by voxel and time; some 120 bytes.

    Attributes:
        key: (n,) the voxel.
        first_s, last_s: (n,) of the stamps that saw it.
        point_sum: (n, 3).
        value_sum: (n, v) of colours or what else points carry.
        count: (n,) points.
        hits: (n,) clouds.
        nearest_m, nearest_s, nearest_pose: (n,) range, stamp and pose of the point seen from nearest by.
    """

    key: Int[np.ndarray, "n"]
    first_s: Float[np.ndarray, "n"]
    last_s: Float[np.ndarray, "n"]
    point_sum: Float[np.ndarray, "n 3"]
    value_sum: Float[np.ndarray, "n v"]
    count: Int[np.ndarray, "n"]
    hits: Int[np.ndarray, "n"]
    nearest_m: Float[np.ndarray, "n"]
    nearest_s: Float[np.ndarray, "n"]
    nearest_pose: Int[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.key)

    def take(self, chosen: Int[np.ndarray, "k"] | Bool[np.ndarray, "n"]) -> "VoxelRows":
        """The chosen rows."""
        return VoxelRows(**{name: column[chosen] for name, column in vars(self).items()})


class VoxelTable:
    """Grows by clouds in the order of time; rows of one voxel join where less than `gap_s` lies between them.

    New rows wait until they are half as many as the table's: each row is sorted a few times only.
    """

    def __init__(self, voxel_m: float, gap_s: float):
        self.voxel_m, self.gap_s = voxel_m, gap_s
        self._rows: VoxelRows | None = None
        self._waiting: list[VoxelRows] = []
        self._n_waiting = 0

    def __len__(self) -> int:
        return (0 if self._rows is None else len(self._rows)) + self._n_waiting

    def add(
        self,
        points_m: Float[np.ndarray, "n 3"],
        values: Float[np.ndarray, "n v"],
        range_m: Float[np.ndarray, "n"],
        stamp_s: float,
        pose_index: int,
    ) -> None:
        """Add the points of one cloud, in the map frame.

        Raises:
            CloudError: points that are not finite, or more than a million voxels from the origin.
        """
        if len(points_m) == 0:
            return
        n = len(points_m)
        stamps = np.full(n, stamp_s)
        one = VoxelRows(
            self._keys(points_m, pose_index),
            stamps,
            stamps,
            points_m,
            values,
            np.ones(n, dtype=np.int64),
            np.ones(n, dtype=np.int64),
            range_m.astype(np.float64),
            stamps,
            np.full(n, pose_index, dtype=np.int64),
        )
        joined = _joined(one, np.inf)
        self._waiting.append(dataclasses.replace(joined, hits=np.ones_like(joined.hits)))
        self._n_waiting += len(joined)
        if self._n_waiting > max(_MANY_ROWS, 0 if self._rows is None else len(self._rows) // 2):
            self._settle()

    def rows(self, min_hits: int = 1) -> VoxelRows:
        """All rows of the voxels that at least `min_hits` clouds hit, in whatever pass."""
        self._settle()
        assert self._rows is not None
        rows = self._rows
        starts = np.flatnonzero(np.diff(rows.key, prepend=rows.key[0] - 1))
        total = np.repeat(np.add.reduceat(rows.hits, starts), np.diff(starts, append=len(rows)))
        return rows if min_hits <= 1 else rows.take(total >= min_hits)

    def _settle(self) -> None:
        if self._waiting:
            parts = ([] if self._rows is None else [self._rows]) + self._waiting
            self._rows = _joined(_stacked(parts), self.gap_s)
            self._waiting, self._n_waiting = [], 0

    def _keys(self, points_m: Float[np.ndarray, "n 3"], pose_index: int) -> Int[np.ndarray, "n"]:
        cell = np.floor(points_m / self.voxel_m)
        bad = np.flatnonzero(~(np.abs(cell) < _REACH).all(axis=1))  # NaN too
        if bad.size:
            x, y, z = points_m[bad[0]]
            raise CloudError(
                f"cloud of pose {pose_index}: {bad.size} of {len(points_m)} points, such as ({x:g}, {y:g}, {z:g}) m, "
                f"are not finite or more than {_REACH * self.voxel_m:g} m from the map's origin; expected local "
                "coordinates. Subtract an origin near the data, or take larger voxels."
            )
        x, y, z = cell.astype(np.int64).T + _REACH
        return (x << 2 * _BITS) | (y << _BITS) | z


def _stacked(parts: list[VoxelRows]) -> VoxelRows:
    columns = [vars(part) for part in parts]
    return VoxelRows(**{name: np.concatenate([column[name] for column in columns]) for name in columns[0]})


def _joined(rows: VoxelRows, gap_s: float) -> VoxelRows:
    """Rows of one voxel joined where at most `gap_s` lies between them, sorted by voxel and time.

    Clouds come in the order of time, so of two rows of a voxel one ends before the other begins.
    """
    order = np.lexsort((rows.first_s, rows.key))
    rows = rows.take(order)
    new = (np.diff(rows.key) != 0) | (rows.first_s[1:] - rows.last_s[:-1] > gap_s)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1])
    group = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(rows)))
    nearest = np.lexsort((rows.nearest_m, group))[starts]
    return VoxelRows(
        rows.key[starts],
        rows.first_s[starts],
        np.maximum.reduceat(rows.last_s, starts),
        np.add.reduceat(rows.point_sum, starts),
        np.add.reduceat(rows.value_sum, starts) if rows.value_sum.shape[1] else rows.value_sum[starts],
        np.add.reduceat(rows.count, starts),
        np.add.reduceat(rows.hits, starts),
        rows.nearest_m[nearest],
        rows.nearest_s[nearest],
        rows.nearest_pose[nearest],
    )
