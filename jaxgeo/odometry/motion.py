"""Where the next scan is expected: the sensor goes on as it did, give or take an acceleration."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.geometry.rigid import exp, inverse, log

EXTRAPOLATE_S = 1.0  # over longer gaps nobody keeps a velocity
FLOOR = np.array([0.02, 0.01])  # m, rad: the noise of the poses themselves, of which the velocity is a difference
UNKNOWN = np.array([2.0, 0.5])  # m, rad: the sigma of a first step
MEMORY = 0.9  # of the running mean of squared deviations: about ten scans


@dataclasses.dataclass(frozen=True)
class Motion:
    """The last pose, the velocity, and how well the model foretold the recent poses.

    Attributes:
        stamp_s: of the last pose.
        T_map_lidar: the last pose.
        twist: (6,) velocity in the sensor's own frame, (m/s, rad/s); None while there is but one pose.
        deviation_squared: (2,) running means of the squared deviations from the predictions, (m^2, rad^2).
    """

    stamp_s: float
    T_map_lidar: Float[np.ndarray, "4 4"]
    twist: Float[np.ndarray, "6"] | None = None
    deviation_squared: Float[np.ndarray, "2"] = dataclasses.field(default_factory=lambda: np.zeros(2))

    def step(self, stamp_s: float) -> Float[np.ndarray, "4 4"]:
        """The motion expected until `stamp_s`, `T_last_next`."""
        if self.twist is None:
            return np.eye(4)
        return exp(self.twist * min(stamp_s - self.stamp_s, EXTRAPOLATE_S))

    def sigma(self, stamp_s: float, acceleration: tuple[float, float]) -> Float[np.ndarray, "6"]:
        """Standard deviations of that expectation, (m, rad): an acceleration over the interval, or what was seen."""
        dt_s = stamp_s - self.stamp_s
        if self.twist is None:
            return np.repeat(UNKNOWN, 3)
        physical = FLOOR + np.array(acceleration) * dt_s**2
        return np.repeat(np.maximum(physical, np.sqrt(self.deviation_squared)), 3)

    def deviation(self, stamp_s: float, T_map_lidar: Float[np.ndarray, "4 4"]) -> tuple[float, float]:
        """How far a pose lies from the expected one, (m, rad); a first step deviates from nothing."""
        if self.twist is None:
            return 0.0, 0.0
        tangent = log(inverse(self.T_map_lidar @ self.step(stamp_s)) @ T_map_lidar)
        return float(np.linalg.norm(tangent[:3])), float(np.linalg.norm(tangent[3:]))

    def after(self, stamp_s: float, T_map_lidar: Float[np.ndarray, "4 4"]) -> "Motion":
        """The state once the scan of `stamp_s` has its pose."""
        return Motion(
            stamp_s,
            T_map_lidar,
            log(inverse(self.T_map_lidar) @ T_map_lidar) / (stamp_s - self.stamp_s),
            MEMORY * self.deviation_squared + (1.0 - MEMORY) * np.square(self.deviation(stamp_s, T_map_lidar)),
        )
