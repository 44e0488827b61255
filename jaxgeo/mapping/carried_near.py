"""Carrying a cloud that says neither when nor from where its points were seen: by the poses nearest to them.

Stations are taken along the path at even distances, so that a pause does not outweigh a walk. A point moves with the
mean of the corrections of its nearest stations, each weighted by (1 - d / d_next)^2, d_next the distance of the first
one left out (Sumner, Schmid, Pauly, "Embedded deformation for shape manipulation", SIGGRAPH 2007): a station enters and
leaves with weight zero, so the cloud gets no seams. Where the trajectory passes twice, nobody knows which pass saw the
point: it goes between the two, and the answer says how far apart they would have put it.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxgeo.mapping.carry import Place, PoseCorrections, carry, turn

NEIGHBOURS = 6
_STATIONS = 200  # at least so many on a path, as long as they are
_SPACING_M = (0.1, 1.0)
# Another pass: along the path farther from the nearest station than so many times the straight way, and some stations.
_DETOUR, _STATIONS_APART = 3.0, 4.0


@dataclasses.dataclass(frozen=True)
class Stations:
    """Poses at even distances along the trajectory before.

    Attributes:
        index: (s,) rows of `PoseCorrections`.
        along_m: (s,) path length up to them.
        spacing_m: between them, at least.
        tree: of their positions.
    """

    index: Int[np.ndarray, "s"]
    along_m: Float[np.ndarray, "s"]
    spacing_m: float
    tree: KDTree


@dataclasses.dataclass(frozen=True)
class NearCarried:
    """Points carried by their nearest stations.

    Attributes:
        points_m: (n, 3) in the frame of the trajectory after.
        normal: (n, 3) unit; None where none were given.
        twice: (n,) stations of another pass are among the nearest.
        gap_m: (n,) how far apart the nearest station and those of other passes would have put the point; 0 where not
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
    return Stations(index, along_m[index], spacing_m, KDTree(corrections.before_m[index]))


def carry_near(
    corrections: PoseCorrections,
    stations: Stations,
    points_m: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"] | None = None,
) -> NearCarried:
    """Carry points with the stations nearest to them."""
    distance_m, station = _neighbours(stations, corrections.scale * np.asarray(points_m, dtype=np.float64))
    weight = _weights(distance_m)
    total, turned = np.zeros((len(points_m), 3)), np.zeros((len(points_m), 3))
    twice, gap_m = np.zeros(len(points_m), bool), np.zeros(len(points_m))
    first = np.zeros(0)
    for k in range(weight.shape[1]):
        place = _place_of(corrections, stations.index[station[:, k]])
        carried_m = carry(corrections, points_m, place)
        total += weight[:, k : k + 1] * carried_m
        if normal is not None:
            turned += weight[:, k : k + 1] * turn(corrections, normal, place)
        first = carried_m if k == 0 else first
        other = _another_pass(corrections, stations, station[:, 0], station[:, k])
        twice |= other
        gap_m = np.maximum(gap_m, np.where(other, np.linalg.norm(carried_m - first, axis=1), 0.0))
    return NearCarried(total, None if normal is None else _of_length(turned, normal), twice, gap_m)


def _neighbours(stations: Stations, points_m: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Distances and stations, (n, k) each, nearest first; the last only says where the weights end."""
    count = min(NEIGHBOURS + 1, len(stations.index))
    distance_m, station = stations.tree.query(points_m, k=count, workers=-1)
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


def _another_pass(
    corrections: PoseCorrections, stations: Stations, a: Int[np.ndarray, "n"], b: Int[np.ndarray, "n"]
) -> Bool[np.ndarray, "n"]:
    position_m = corrections.before_m[stations.index]
    straight_m = np.linalg.norm(position_m[a] - position_m[b], axis=1)
    along_m = np.abs(stations.along_m[a] - stations.along_m[b])
    return along_m > _DETOUR * straight_m + _STATIONS_APART * stations.spacing_m


def _of_length(turned: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The mean direction, as long as it was."""
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned * np.linalg.norm(normal, axis=1, keepdims=True) / np.where(length > 0.0, length, 1.0)
