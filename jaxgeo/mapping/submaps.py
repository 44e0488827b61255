"""Clouds of keyframes, and the submaps that are put together from them.

One scan of a sensor that looks only ahead shares little with a scan of the same place on the way back; all scans along
a few metres of path share much.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Scan, Trajectory
from jaxgeo.geometry.rigid import apply, inverse
from jaxgeo.mapping.keyframes import Keyframes
from jaxgeo.mapping.placed_scans import placed_scans
from jaxgeo.mapping.scene_scale import SceneScale, thinned

_PENDING = 10  # scans put together before they are thinned


@dataclasses.dataclass(frozen=True)
class KeyframeClouds:
    """What the sensor saw from each keyframe until the next, thinned.

    Attributes:
        points_m: k arrays (n, 3) float32, in the body frame of the keyframe: 12 bytes a point.
        n_scans: scans in them.
        outside: scans whose stamp lies outside the trajectory; they are left out.
    """

    points_m: Sequence[Float[np.ndarray, "n 3"]]
    n_scans: int
    outside: int

    def __len__(self) -> int:
        return len(self.points_m)

    @property
    def nbytes(self) -> int:
        return sum(points.nbytes for points in self.points_m)


def keyframe_clouds(
    scans: Iterable[Scan],
    trajectory: Trajectory,
    keyframes: Keyframes,
    T_body_lidar: Float[np.ndarray, "4 4"],
    scale: SceneScale,
    on_scan: Callable[[], None] | None = None,
) -> KeyframeClouds:
    """Place every scan at its pose and give it to the last keyframe before it; one scan is in memory at a time."""
    clouds: list[Float[np.ndarray, "n 3"]] = [np.zeros((0, 3), np.float32) for _ in range(len(keyframes))]
    pending: list[list[Float[np.ndarray, "n 3"]]] = [[] for _ in clouds]
    n_scans = outside = 0
    for placed in placed_scans(scans, trajectory, T_body_lidar):
        if on_scan is not None:
            on_scan()
        if placed.T_map_body is None:
            outside += 1
            continue
        n_scans += 1
        k = max(int(np.searchsorted(keyframes.stamp_s, placed.scan.stamp_s, side="right")) - 1, 0)
        near = placed.points_body_m[np.linalg.norm(placed.scan.points_m, axis=1) < scale.max_range_m]
        T_key_body = inverse(keyframes.T_map_body[k]) @ placed.T_map_body
        pending[k].append(apply(T_key_body, thinned(near, scale.voxel_m)).astype(np.float32))
        if len(pending[k]) >= _PENDING:
            _thin(clouds, pending, k, scale.voxel_m)
    for k in range(len(clouds)):
        _thin(clouds, pending, k, scale.voxel_m)
    return KeyframeClouds(clouds, n_scans, outside)


def _thin(clouds: list, pending: list[list], k: int, voxel_m: float) -> None:
    if pending[k]:
        clouds[k] = thinned(np.concatenate([clouds[k], *pending[k]]), voxel_m).astype(np.float32)
        pending[k] = []


def submap(
    clouds: KeyframeClouds,
    T_map_body: Float[np.ndarray, "k 4 4"],
    path_m: Float[np.ndarray, "k"],
    k: int,
    scale: SceneScale,
) -> Float[np.ndarray, "n 3"]:
    """The clouds within reach of keyframe k along the path, in its body frame, thinned."""
    first, last = np.searchsorted(path_m, [path_m[k] - scale.reach_m, path_m[k] + scale.reach_m])
    back = inverse(T_map_body[k])
    placed = [apply(back @ T_map_body[j], clouds.points_m[j].astype(np.float64)) for j in range(first, last)]
    return thinned(np.concatenate(placed), scale.voxel_m)


def path_length_m(T_map_body: Float[np.ndarray, "k 4 4"]) -> Float[np.ndarray, "k"]:
    """Length of the path up to every pose."""
    steps = np.linalg.norm(np.diff(T_map_body[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
