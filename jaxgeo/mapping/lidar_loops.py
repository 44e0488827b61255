"""Loops from LiDAR: keyframes' clouds to submaps, candidates and verified closures."""

import functools
from collections import Counter
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jaxgeo.geometry.rigid import inverse
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.lidar_closures import LidarPlace, VerificationSettings, lidar_closures, lidar_place
from jaxgeo.mapping.loop_candidates import CandidateSettings, believable, loop_candidates
from jaxgeo.mapping.scan_context import ScanContexts, scan_context, scan_contexts
from jaxgeo.mapping.scene_scale import SceneScale
from jaxgeo.mapping.submaps import KeyframeClouds, path_length_m, submap

_FEWEST_POINTS = 200
_PLACES_KEPT = 256  # prepared submaps in memory: some 2 MB each
_REGISTRATION_VOXEL = 1.5  # in voxels of the clouds
_CONTEXT_RADIUS = 3.0  # in median ranges
_NEAR = 0.3  # two keyframes within this part of the median range see the same

Progress = Callable[[int, int], None]


class LidarLoops:
    """Looks for loops among the submaps of one trajectory's keyframes.

    Args:
        clouds: of the keyframes.
        T_map_body: (k, 4, 4) by the odometry, z up: submaps are put together with it.
    """

    def __init__(
        self, clouds: KeyframeClouds, T_map_body: Float[np.ndarray, "k 4 4"], scale: SceneScale, threads: int = 1
    ) -> None:
        self._T_map_body = T_map_body
        self._path_m = path_length_m(T_map_body)
        self._threads = threads
        self.verification = VerificationSettings()
        self.candidates = CandidateSettings(gap_m=max(4.0 * scale.reach_m, scale.range_m), near_m=_NEAR * scale.range_m)

        @functools.lru_cache(_PLACES_KEPT)
        def place(k: int) -> LidarPlace | None:
            return prepared(submap(clouds, T_map_body, self._path_m, k, scale), scale, self.verification, threads)

        self._place = place
        self._contexts = _contexts(clouds, T_map_body, self._path_m, scale)

    def find(
        self,
        known: frozenset[tuple[int, int]],
        T_map_body: Float[np.ndarray, "k 4 4"] | None = None,
        on_progress: Progress | None = None,
    ) -> tuple[list[Closure], Counter[str], frozenset[tuple[int, int]]]:
        """Verified closures between pairs not in `known`; how many were refused, by reason; all pairs known now.

        Args:
            T_map_body: better poses than the odometry's: loops are then looked for where these come near one another.
        """
        contexts = self._contexts if T_map_body is None else None
        T = self._T_map_body if T_map_body is None else T_map_body
        found = [
            one
            for one in loop_candidates(T, self._path_m, contexts, self.candidates)
            if (one.first, one.second) not in known
        ]
        closures, refused = lidar_closures(
            found, self._place, self.verification, threads=self._threads, on_progress=on_progress
        )
        kept = [c for c in closures if self._believable(c)]
        refused["beyond belief"] += len(closures) - len(kept)
        return kept, +refused, known | {(one.first, one.second) for one in found}

    def _believable(self, closure: Closure) -> bool:
        odometry = inverse(self._T_map_body[closure.first]) @ self._T_map_body[closure.second]
        gap_m = float(self._path_m[closure.second] - self._path_m[closure.first])
        return believable(closure.T_first_second, odometry, gap_m, self.candidates)


def prepared(
    points_m: Float[np.ndarray, "n 3"], scale: SceneScale, verification: VerificationSettings, threads: int
) -> LidarPlace | None:
    """A cloud ready for verification; None where it has too few points."""
    if len(points_m) < _FEWEST_POINTS:
        return None
    return lidar_place(points_m.astype(np.float64), _REGISTRATION_VOXEL * scale.voxel_m, verification, threads)


def _contexts(
    clouds: KeyframeClouds, T_map_body: Float[np.ndarray, "k 4 4"], path_m: Float[np.ndarray, "k"], scale: SceneScale
) -> ScanContexts:
    """Descriptors of all submaps, level by the odometry's attitude."""
    radius_m = _CONTEXT_RADIUS * scale.range_m
    return scan_contexts(
        [
            scan_context(submap(clouds, T_map_body, path_m, k, scale) @ T_map_body[k, :3, :3].T, radius_m)
            for k in range(len(clouds))
        ]
    )
