"""How large a scene is, and the lengths that mapping takes from it."""

import dataclasses

import numpy as np
from jaxtyping import Float

# Shares of the median range. A LiDAR's points are denser the nearer the walls are: a voxel of 2 % of the range holds a
# few points of every sensor tried, and submaps and keyframes follow what one scan sees.
_VOXEL = (0.02, 0.05, 0.5)  # share, least, most (metres)
_KEYFRAME = (0.1, 0.25, 3.0)
_REACH = 0.25
_RANGE = 5.0


@dataclasses.dataclass(frozen=True)
class SceneScale:
    """Lengths of one recording, metres.

    Attributes:
        range_m: median distance of the points from the sensor.
        voxel_m: clouds are thinned to one point a voxel.
        keyframe_m: distance from keyframe to keyframe.
        reach_m: a keyframe's submap holds the scans within this length of path, before and after it.
        max_range_m: points farther than this from their sensor are left out.
    """

    range_m: float
    voxel_m: float
    keyframe_m: float
    reach_m: float
    max_range_m: float


def scene_scale(median_range_m: float, voxel_m: float | None = None, keyframe_m: float | None = None) -> SceneScale:
    """The lengths that follow from the median range; those given are kept."""

    def share(rule: tuple[float, float, float]) -> float:
        return float(np.clip(rule[0] * median_range_m, rule[1], rule[2]))

    return SceneScale(
        range_m=median_range_m,
        voxel_m=share(_VOXEL) if voxel_m is None else voxel_m,
        keyframe_m=share(_KEYFRAME) if keyframe_m is None else keyframe_m,
        reach_m=_REACH * median_range_m,
        max_range_m=_RANGE * median_range_m,
    )


def thinned(points_m: Float[np.ndarray, "n 3"], voxel_m: float) -> Float[np.ndarray, "m 3"]:
    """The mean of the points in every voxel of a grid about the origin."""
    if len(points_m) == 0:
        return points_m
    cell = np.floor(points_m / voxel_m).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    order = np.argsort(key, kind="stable")
    key = key[order]
    start = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    count = np.diff(np.append(start, len(key)))
    return np.add.reduceat(points_m[order], start, axis=0) / count[:, None]
