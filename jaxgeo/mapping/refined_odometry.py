"""The odometry between keyframes, checked and sharpened by the scans of neighbouring ones."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.geometry.rigid import inverse, log
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.keyframe_graph import chain_and, solve_keyframes
from jaxgeo.mapping.lidar_closures import LidarPlace, VerificationSettings, agreement, lidar_closures
from jaxgeo.mapping.loop_candidates import LoopCandidate
from jaxgeo.solve.closure_graph import ClosureSettings

_CHI2_6 = 22.46  # 99.9 %
# An odometry edge is disproved where its clouds agree less than this part of what registration reaches.
_DISPROVED = 0.6
_NEIGHBOURS = (1, 2)  # keyframes further on


@dataclasses.dataclass(frozen=True)
class RefinedOdometry:
    """Keyframes before any loop is closed.

    Attributes:
        T_map_body: (k, 4, 4).
        covariance: (k - 1, 6, 6) of the given odometry's edges: wider where the scans disproved it.
        disproved: edges that the scans contradict.
        neighbours: registrations that are not contradicted.
    """

    T_map_body: Float[np.ndarray, "k 4 4"]
    covariance: Float[np.ndarray, "e 6 6"]
    disproved: Int[np.ndarray, "d"]
    neighbours: Sequence[Closure]


def refine_odometry(
    T_map_body: Float[np.ndarray, "k 4 4"],
    covariance: Float[np.ndarray, "e 6 6"],
    place: Callable[[int], LidarPlace | None],
    verification: VerificationSettings,
    settings: ClosureSettings,
    *,
    threads: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> RefinedOdometry:
    """Register every keyframe's cloud with the next ones' and solve odometry and registrations together.

    An edge is disproved where the registration lies outside the odometry's noise (99.9 %, sigmas doubled) and the
    clouds, laid together by the odometry, agree clearly less: its covariance grows by the square of the difference.
    Where they agree as well that way, the registration is left out.

    Args:
        place: a keyframe's own cloud, prepared; None where it holds too few points.
    """
    found, _ = lidar_closures(_neighbours(T_map_body), place, verification, threads=threads, on_progress=on_progress)
    found, covariance, disproved = _judged(T_map_body, covariance, found, place)
    if not found:
        return RefinedOdometry(T_map_body, covariance, disproved, [])
    solved = solve_keyframes(T_map_body, chain_and(T_map_body, covariance, found), settings)
    kept = [c for c, weight in zip(found, solved.weight[len(covariance) :], strict=True) if weight > 0.5]
    return RefinedOdometry(solved.T_map_body, covariance, disproved, kept)


def _neighbours(T_map_body: Float[np.ndarray, "k 4 4"]) -> list[LoopCandidate]:
    """Each keyframe with the next ones; begun at the odometry, and at no motion in case the odometry broke there."""
    pairs = []
    for second in range(1, len(T_map_body)):
        for first in (second - step for step in _NEIGHBOURS if second >= step):
            odometry = inverse(T_map_body[first]) @ T_map_body[second]
            pairs.append(LoopCandidate(first, second, np.stack([odometry, np.eye(4)]), False))
    return pairs


def _judged(
    T_map_body: Float[np.ndarray, "k 4 4"],
    covariance: Float[np.ndarray, "e 6 6"],
    found: Sequence[Closure],
    place: Callable[[int], LidarPlace | None],
) -> tuple[list[Closure], Float[np.ndarray, "e 6 6"], Int[np.ndarray, "d"]]:
    """The registrations to be used, the odometry's covariance, and the edges that are disproved.

    Edges between successive keyframes are trusted by the solver, so here it is decided which of the two is.
    """
    covariance = covariance.copy()
    kept, disproved = [], []
    for c in found:
        if c.second > c.first + 1:
            kept.append(c)
            continue
        odometry = inverse(T_map_body[c.first]) @ T_map_body[c.second]
        error = log(inverse(c.T_first_second) @ odometry)
        spread = 4.0 * covariance[c.first] + np.linalg.inv(c.information)
        if error @ np.linalg.solve(spread, error) < _CHI2_6:
            kept.append(c)
            continue
        first, second = place(c.first), place(c.second)
        assert first is not None  # they were registered
        assert second is not None
        by_odometry = agreement(first.coarse, second.coarse, odometry)
        if by_odometry < _DISPROVED * agreement(first.coarse, second.coarse, c.T_first_second):
            kept.append(c)
            disproved.append(c.first)
            covariance[c.first] += np.diag([error[:3] @ error[:3]] * 3 + [error[3:] @ error[3:]] * 3)
    return kept, covariance, np.array(disproved, dtype=int)
