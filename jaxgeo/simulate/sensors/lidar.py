"""A spinning LiDAR: rings of rays that turn while the rig moves."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from jaxgeo.data import Scan
from jaxgeo.errors import InputError
from jaxgeo.simulate.sensors.ray_casting import Scene
from jaxgeo.simulate.sensors.texture import REFLECTIVITY

# A face on target of this reflectivity is met half of the time at the longest range.
_HALF_REFLECTIVITY = 0.1


@dataclasses.dataclass(frozen=True)
class Lidar:
    """What the sensor is like.

    Attributes:
        rings, columns: rays above each other, and directions in one turn.
        rate_hz: turns a second, one scan each.
        lowest_rad, highest_rad: elevation of the outer rings.
        min_range_m, max_range_m: nothing is measured beyond.
        range_sigma_m: noise along the ray.
        ring_range_sigma_m, ring_elevation_sigma_rad: what the factory's calibration leaves: errors of whole rings that
            stay (`ring_errors`). From them, not from noise, odometry drifts.
        drop_out: share of the echoes that are lost anyway.

    Raises:
        InputError: a number is out of range.
    """

    rings: int = 16
    columns: int = 600
    rate_hz: float = 5.0
    lowest_rad: float = float(np.deg2rad(-20.0))
    highest_rad: float = float(np.deg2rad(15.0))
    min_range_m: float = 0.4
    max_range_m: float = 20.0
    range_sigma_m: float = 0.015
    ring_range_sigma_m: float = 0.015
    ring_elevation_sigma_rad: float = float(np.deg2rad(0.1))
    drop_out: float = 0.02

    def __post_init__(self) -> None:
        if self.rings < 1 or self.columns < 8 or not 0.5 <= self.rate_hz <= 100.0:
            raise InputError(
                f"LiDAR: {self.rings} rings, {self.columns} columns, {self.rate_hz:g} Hz; expected a ring, eight "
                "columns or more, and 0.5 to 100 Hz."
            )
        if not 0 <= self.min_range_m < self.max_range_m or self.range_sigma_m < 0 or not 0 <= self.drop_out < 1:
            raise InputError(
                f"LiDAR: ranges {self.min_range_m:g} to {self.max_range_m:g} m, noise {self.range_sigma_m:g} m, "
                f"drop-out {self.drop_out:g}; expected a shorter and a longer range, noise of 0 m or more, drop-out "
                "below 1."
            )

    def elevation_rad(self) -> Float[np.ndarray, "r"]:
        """Of the rings, from the lowest."""
        return np.linspace(self.lowest_rad, self.highest_rad, self.rings)


@dataclasses.dataclass(frozen=True)
class RingErrors:
    """By how much the rings of one sensor measure too far, and look higher than they are said to."""

    range_m: Float[np.ndarray, "r"]
    elevation_rad: Float[np.ndarray, "r"]


def ring_errors(rng: np.random.Generator, lidar: Lidar) -> RingErrors:
    """Errors of a sensor's calibration, drawn once for its life."""
    range_m, elevation_rad = rng.standard_normal((2, lidar.rings))
    return RingErrors(lidar.ring_range_sigma_m * range_m, lidar.ring_elevation_sigma_rad * elevation_rad)


def render_scan(
    rng: np.random.Generator,
    lidar: Lidar,
    errors: RingErrors,
    scene: Scene,
    T_local_lidar: Callable[[Float[np.ndarray, "c"]], RigidTransform],
    stamp_s: float,
    index: int,
) -> Scan:
    """One turn; each column is measured from where the sensor is by then.

    Args:
        T_local_lidar: the sensor's poses at times after the scan's start, seconds.
        stamp_s: of the turn's start.

    Returns:
        The echoes, each in the sensor's frame at its own time; intensity 0 to 255, in order of time.
    """
    after_s = np.arange(lidar.columns) / (lidar.columns * lidar.rate_hz)
    azimuth_rad = -2.0 * np.pi * np.arange(lidar.columns) / lidar.columns + np.pi  # clockwise, from behind
    ray = _rays(azimuth_rad, lidar.elevation_rad())  # as the sensor believes
    true_ray = _rays(azimuth_rad, lidar.elevation_rad() + errors.elevation_rad)
    pose = T_local_lidar(after_s)
    seen = np.einsum("cij,crj->cri", pose.rotation.as_matrix(), true_ray).reshape(-1, 3)
    origin_m = np.repeat(pose.translation, lidar.rings, axis=0)
    hits = scene.cast(origin_m.astype(np.float32), seen.astype(np.float32))
    facing = np.abs(np.sum(hits.normal * seen, axis=1))
    material = scene.mesh.material[hits.triangle]
    echo = np.where(hits.met, REFLECTIVITY[material] * facing, 0.0)
    range_m = hits.t + np.tile(errors.range_m, lidar.columns) + lidar.range_sigma_m * rng.standard_normal(len(seen))
    with np.errstate(invalid="ignore", over="ignore"):
        faint = 2.0 ** (-echo / _HALF_REFLECTIVITY * np.maximum(lidar.max_range_m / hits.t, 1.0) ** 2)
    kept = (
        hits.met
        & (range_m >= lidar.min_range_m)
        & (range_m <= lidar.max_range_m)
        & (rng.uniform(size=len(seen)) >= faint)
        & (rng.uniform(size=len(seen)) >= lidar.drop_out)
    )
    level_noise = rng.normal(1.0, 0.05, len(seen))
    return Scan(
        stamp_s=stamp_s,
        points_m=ray.reshape(-1, 3)[kept] * range_m[kept, None].astype(np.float64),
        time_s=np.repeat(after_s, lidar.rings)[kept],
        intensity=np.clip(np.rint(255.0 * echo * level_noise), 0, 255)[kept],
        source=f"simulated:{index}",
        index=index,
    )


def _rays(azimuth_rad: Float[np.ndarray, "c"], elevation_rad: Float[np.ndarray, "r"]) -> Float[np.ndarray, "c r 3"]:
    level = np.cos(elevation_rad)
    up = np.broadcast_to(np.sin(elevation_rad), (len(azimuth_rad), len(elevation_rad)))
    return np.stack([np.cos(azimuth_rad)[:, None] * level, np.sin(azimuth_rad)[:, None] * level, up], axis=-1)
