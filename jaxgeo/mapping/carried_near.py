"""Carrying a cloud that says neither when nor from where its points were seen: by the poses nearest to them.

Stations are taken along the path at even distances, so that a pause does not outweigh a walk. A point moves with the
mean of the corrections of its nearest stations, each weighted by (1 - d / d_next)^2, d_next the distance of the first
one left out (Sumner, Schmid, Pauly, "Embedded deformation for shape manipulation", SIGGRAPH 2007): a station enters and
leaves with weight zero, so the cloud gets no seams. Where the trajectory passes twice, nobody knows which pass saw the
point: it goes with the nearer one, or between the two, and the answer says how far off the other would have put it.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxgeo.mapping.carry import Place, PoseCorrections, carry, turn

NEIGHBOURS = 6
_STATIONS = 200  # at least so many on a path, as long as they are
_SPACING_M = (0.1, 1.0)
# Another pass: the way along the path is so many times the straight one, and some stations more.
_DETOUR, _STATIONS_APART = 3.0, 4.0
_ROWS = 256


@dataclasses.dataclass(frozen=True)
class Stations:
    """Poses at even distances along the trajectory before.

    Attributes:
        index: (s,) rows of `PoseCorrections`.
        position_m: (s, 3) of them.
        other: (s,) for every station the nearest one of another pass; -1 where there is none.
        tree: of their positions.
    """

    index: Int[np.ndarray, "s"]
    position_m: Float[np.ndarray, "s 3"]
    other: Int[np.ndarray, "s"]
    tree: KDTree


@dataclasses.dataclass(frozen=True)
class NearCarried:
    """Points carried by their nearest stations.

    Attributes:
        points_m: (n, 3) in the frame of the trajectory after.
        normal: (n, 3) unit; None where none were given.
        twice: (n,) a station of another pass lies within reach too.
        gap_m: (n,) how far from where the nearest station would have put the point that one would have; 0 where not
            `twice`.
    """

    points_m: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"] | None
    twice: Bool[np.ndarray, "n"]
    gap_m: Float[np.ndarray, "n"]


def stations_of(corrections: PoseCorrections) -> Stations:
    """Stations every metre, closer on paths below 200 m, but at least 0.1 m apart."""
    step_m = np.linalg.norm(np.diff(corrections.before_m, axis=0), axis=1)
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    spacing_m = float(np.clip(along_m[-1] / _STATIONS, *_SPACING_M))
    _, index = np.unique(np.floor(along_m / spacing_m), return_index=True)
    position_m = corrections.before_m[index]
    other = _other_passes(position_m, along_m[index], _STATIONS_APART * spacing_m)
    return Stations(index, position_m, other, KDTree(position_m))


def reach_of(corrections: PoseCorrections, stations: Stations, points_m: Float[np.ndarray, "n 3"]) -> float:
    """From how far away points are seen, metres: 95 % of these lie nearer to their nearest station."""
    return float(np.quantile(stations.tree.query(corrections.scale * points_m)[0], 0.95))


def carry_near(
    corrections: PoseCorrections,
    stations: Stations,
    points_m: Float[np.ndarray, "n 3"],
    reach_m: float,
    normal: Float[np.ndarray, "n 3"] | None = None,
) -> NearCarried:
    """Carry points with the stations nearest to them.

    Args:
        reach_m: from how far away another pass may have seen them, `reach_of`.
    """
    distance_m, station = _neighbours(stations, corrections.scale * np.asarray(points_m, dtype=np.float64))
    weight = _weights(distance_m)
    total, turned = np.zeros((len(points_m), 3)), np.zeros((len(points_m), 3))
    for k in range(weight.shape[1]):
        place = _place_of(corrections, stations.index[station[:, k]])
        total += weight[:, k : k + 1] * carry(corrections, points_m, place)
        if normal is not None:
            turned += weight[:, k : k + 1] * turn(corrections, normal, place)
    twice, gap_m = _gaps(corrections, stations, points_m, station[:, 0], reach_m)
    return NearCarried(total, None if normal is None else _of_length(turned, normal), twice, gap_m)


def _neighbours(stations: Stations, points_m: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Distances and stations, (n, k) each, nearest first; the last only says where the weights end."""
    count = min(NEIGHBOURS + 1, len(stations.index))
    # In one thread: SciPy leaves its workers running when an interrupt comes, and the process ends in a fault.
    distance_m, station = stations.tree.query(points_m, k=count)
    return distance_m.reshape(-1, count), station.reshape(-1, count)


def _weights(distance_m: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n j"]:
    """Shares of the nearest stations, (n, k - 1); of all k where the path has no more."""
    if distance_m.shape[1] > NEIGHBOURS:
        weight = (distance_m[:, -1:] - distance_m[:, :-1]) ** 2
    else:
        weight = (2.0 * distance_m[:, -1:] - distance_m) ** 2
    total = weight.sum(axis=1, keepdims=True)
    # All at one distance: all alike.
    return np.where(total > 0.0, weight / np.where(total > 0.0, total, 1.0), 1.0 / weight.shape[1])


def _place_of(corrections: PoseCorrections, pose: Int[np.ndarray, "n"]) -> Place:
    index = np.minimum(pose, len(corrections) - 2)
    return Place(index, (pose - index).astype(np.float64))


def _gaps(
    corrections: PoseCorrections,
    stations: Stations,
    points_m: Float[np.ndarray, "n 3"],
    nearest: Int[np.ndarray, "n"],
    reach_m: float,
) -> tuple[Bool[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """`twice` and `gap_m` of `NearCarried`."""
    other = stations.other[nearest]
    away_m = np.linalg.norm(corrections.scale * points_m - stations.position_m[other], axis=1)
    twice = (other >= 0) & (away_m <= reach_m)
    one, two = (
        carry(corrections, points_m[twice], _place_of(corrections, stations.index[each[twice]]))
        for each in (nearest, other)
    )
    gap_m = np.zeros(len(points_m))
    gap_m[twice] = np.linalg.norm(one - two, axis=1)
    return twice, gap_m


def _other_passes(
    position_m: Float[np.ndarray, "s 3"], along_m: Float[np.ndarray, "s"], apart_m: float
) -> Int[np.ndarray, "s"]:
    """`Stations.other`: the nearest to which the way along the path is a detour."""
    other = np.full(len(position_m), -1)
    for start in range(0, len(position_m), _ROWS):  # all pairs, but never more at once than these rows
        rows = slice(start, start + _ROWS)
        straight_m = np.linalg.norm(position_m[rows, None] - position_m, axis=-1)
        detour = np.abs(along_m[rows, None] - along_m) > _DETOUR * straight_m + apart_m
        nearest = np.argmin(np.where(detour, straight_m, np.inf), axis=1)
        other[rows] = np.where(detour.any(axis=1), nearest, -1)
    return other


def _of_length(turned: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The mean direction, as long as it was."""
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned * np.linalg.norm(normal, axis=1, keepdims=True) / np.where(length > 0.0, length, 1.0)
