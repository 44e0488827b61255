"""Sunlight and shadows: how far the sun sees, kept as one image from its side (Williams 1978)."""

import dataclasses

import numpy as np
from jaxtyping import Float, Float32

from jaxgeo.simulate.sensors.ray_casting import Scene

SUN = np.array([0.38, -0.55, 0.74]) / np.linalg.norm([0.38, -0.55, 0.74])
STEP_M, BIAS_M = 0.05, 0.12
AMBIENT, SKYLIGHT, SUNLIGHT = 0.5, 0.12, 0.55
_AWAY_M = 150.0


@dataclasses.dataclass(frozen=True)
class SunMap:
    """Distances from a plane between sun and world along the sun's rays, on a grid across them."""

    across: Float[np.ndarray, "2 3"]
    low_m: Float[np.ndarray, "2"]
    distance_m: Float32[np.ndarray, "r c"]


def sun_map(scene: Scene, threads: int = 1) -> SunMap:
    """See a scene from the sun."""
    first = np.cross(SUN, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(SUN, first)])
    at_m = scene.mesh.vertex_m @ across.T
    low_m = at_m.min(axis=0)
    count = np.maximum(np.ceil((at_m.max(axis=0) - low_m) / STEP_M).astype(int), 1)
    x = low_m[0] + STEP_M * (np.arange(count[0]) + 0.5)
    distance_m = np.empty((count[1], count[0]), np.float32)
    for j in range(count[1]):
        y = low_m[1] + STEP_M * (j + 0.5)
        origin_m = x[:, None] * across[0] + y * across[1] + _AWAY_M * SUN
        direction = np.broadcast_to(-SUN, origin_m.shape).astype(np.float32)
        distance_m[j] = scene.cast(origin_m.astype(np.float32), direction, threads).t
    return SunMap(across, low_m, distance_m)


def light(sun: SunMap, point_m: Float[np.ndarray, "n 3"], facing: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Brightness of surface points; `facing` is the normal of the side that is seen."""
    at = (point_m @ sun.across.T - sun.low_m) / STEP_M
    i, j = np.clip(at.astype(int), 0, np.array(sun.distance_m.shape[::-1]) - 1).T
    lit = _AWAY_M - point_m @ SUN < sun.distance_m[j, i] + BIAS_M
    return AMBIENT + SKYLIGHT * facing[:, 2] + SUNLIGHT * np.maximum(facing @ SUN, 0.0) * lit
