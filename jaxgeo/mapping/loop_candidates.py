"""Pairs of keyframes that may show the same place, each with first guesses of their relative pose."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxgeo.geometry.rigid import inverse, turn_rad
from jaxgeo.mapping.scan_context import SECTORS, ScanContexts, context_distance

_SECTOR_RAD = 2.0 * np.pi / SECTORS


@dataclasses.dataclass(frozen=True)
class CandidateSettings:
    """Which pairs are looked at.

    Attributes:
        gap_m: pairs with less path between them are neighbours, not loops.
        near_m: two keyframes this near, on top of their drift, may see the same.
        drift_share: drift per path that nearness allows for.
        max_drift_share: drift per path beyond which a pair is not believed, however alike its places look.
        max_turn_rad, max_turn_rad_per_m: nor where the odometry would have turned wrong by more than this.
        context_distance: Scan Context distance below which two places are alike.
        per_keyframe: pairs of each kind with earlier keyframes, at most.
        apart: rows by which the earlier keyframes of one keyframe's pairs differ, at least.
    """

    gap_m: float
    near_m: float
    drift_share: float = 0.02
    max_drift_share: float = 0.15
    max_turn_rad: float = 0.4
    max_turn_rad_per_m: float = 0.01
    context_distance: float = 0.4
    per_keyframe: int = 3
    apart: int = 3


@dataclasses.dataclass(frozen=True)
class LoopCandidate:
    """Two keyframes and where to begin: `starts` (s, 4, 4) of T_first_second; `alike`: found by the descriptor."""

    first: int
    second: int
    starts: Float[np.ndarray, "s 4 4"]
    alike: bool


def loop_candidates(
    T_map_body: Float[np.ndarray, "k 4 4"],
    path_m: Float[np.ndarray, "k"],
    contexts: ScanContexts | None,
    settings: CandidateSettings,
) -> list[LoopCandidate]:
    """Pairs that are near by the odometry, or whose places look alike, in the order of the second keyframe.

    Nearness: `|t| < near_m + drift_share * path between`. Alike: the ring keys' nearest neighbours with a small Scan
    Context distance, unless the odometry would have to have drifted by more than `max_drift_share` of the path.
    A pair found both ways is one candidate with the starts of both.
    """
    starts: dict[tuple[int, int], list[Float[np.ndarray, "4 4"]]] = {}
    alike: set[tuple[int, int]] = set()
    for first, second in _near(T_map_body, path_m, settings):
        starts[first, second] = [inverse(T_map_body[first]) @ T_map_body[second]]
    if contexts is not None:
        for first, second, yaw_rad in _alike(T_map_body, path_m, contexts, settings):
            starts.setdefault((first, second), []).append(_turned(T_map_body[first], T_map_body[second], yaw_rad))
            alike.add((first, second))
    pairs = sorted(starts, key=lambda pair: (pair[1], pair[0]))
    return [LoopCandidate(*pair, np.stack(starts[pair]), pair in alike) for pair in pairs]


def believable(
    T_first_second: Float[np.ndarray, "4 4"],
    T_odometry: Float[np.ndarray, "4 4"],
    gap_m: float,
    settings: CandidateSettings,
) -> bool:
    """Whether odometry may have drifted so far, over this length of path, that the measured motion is the true one."""
    drift = inverse(T_first_second) @ T_odometry
    turn = float(turn_rad(drift))
    allowed_rad = settings.max_turn_rad + settings.max_turn_rad_per_m * gap_m
    return bool(np.linalg.norm(drift[:3, 3]) < drift_allowed_m(gap_m, settings)) and turn < allowed_rad


def drift_allowed_m(
    gap_m: Float[np.ndarray, "n"] | float, settings: CandidateSettings
) -> Float[np.ndarray, "n"] | float:
    """The greatest distance of two keyframes by the odometry that may in truth be at one place."""
    return settings.near_m + settings.max_drift_share * gap_m


def _near(
    T_map_body: Float[np.ndarray, "k 4 4"], path_m: Float[np.ndarray, "k"], settings: CandidateSettings
) -> list[tuple[int, int]]:
    position = T_map_body[:, :3, 3]
    pairs = []
    for second in range(len(position)):
        gap = path_m[second] - path_m[:second]
        distance = np.linalg.norm(position[:second] - position[second], axis=1)
        rows = np.flatnonzero((gap >= settings.gap_m) & (distance < settings.near_m + settings.drift_share * gap))
        pairs += [(first, second) for first in _spread(rows[np.argsort(distance[rows])], settings)]
    return pairs


def _alike(
    T_map_body: Float[np.ndarray, "k 4 4"],
    path_m: Float[np.ndarray, "k"],
    contexts: ScanContexts,
    settings: CandidateSettings,
) -> list[tuple[int, int, float]]:
    position = T_map_body[:, :3, 3]
    tree = KDTree(contexts.ring_key)
    looked_at = min(len(contexts), 10 * settings.per_keyframe + int(np.ceil(settings.gap_m)) + 1)
    _, neighbours = tree.query(contexts.ring_key, k=looked_at)
    found = []
    for second, row in enumerate(np.atleast_2d(neighbours)):
        first = row[row < second]
        gap = path_m[second] - path_m[first]
        distance = np.linalg.norm(position[first] - position[second], axis=1)
        keep = (gap >= settings.gap_m) & (distance < drift_allowed_m(gap, settings))
        seen: dict[int, tuple[float, float]] = {}
        for i, gap_m in zip(first[keep].tolist(), gap[keep].tolist(), strict=True):
            unlike, yaw_rad = context_distance(contexts.context_m[i], contexts.context_m[second])
            # Both descriptors are level by one odometry: the turn between them is its error in heading.
            turned = settings.max_turn_rad + settings.max_turn_rad_per_m * gap_m + _SECTOR_RAD
            if unlike < settings.context_distance and abs(yaw_rad) < turned:
                seen[i] = (unlike, yaw_rad)
        like = sorted(seen, key=lambda i: seen[i][0])
        found += [(i, second, seen[i][1]) for i in _spread(np.array(like, dtype=int), settings)]
    return found


def _spread(rows: np.ndarray, settings: CandidateSettings) -> list[int]:
    """The first rows of an order, those next to a chosen one left out."""
    chosen: list[int] = []
    for row in rows.tolist():
        if len(chosen) < settings.per_keyframe and all(abs(row - other) >= settings.apart for other in chosen):
            chosen.append(row)
    return chosen


def _turned(
    T_map_first: Float[np.ndarray, "4 4"], T_map_second: Float[np.ndarray, "4 4"], yaw_rad: float
) -> Float[np.ndarray, "4 4"]:
    """Both keyframes at one place, the second's level frame turned by the yaw into the first's."""
    T = np.eye(4)
    yaw = Rotation.from_euler("z", yaw_rad).as_matrix()
    T[:3, :3] = T_map_first[:3, :3].T @ yaw @ T_map_second[:3, :3]
    return T
