"""What a method of odometry says of one scan, and what it must offer."""

import dataclasses
from typing import Protocol

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Scan


@dataclasses.dataclass(frozen=True)
class Tracked:
    """The pose of one scan and how much it is to be trusted.

    Attributes:
        T_map_lidar: (4, 4).
        inlier_share: share of the thinned points that found the map.
        deviation_m, deviation_rad: from the pose that the motion before it foretold.
        lost: the scan did not find the map; its pose is a guess.
        converged: the registration did.
        held: see `Match`; NaN where the method does not say.
    """

    T_map_lidar: Float[np.ndarray, "4 4"]
    inlier_share: float
    deviation_m: float
    deviation_rad: float
    lost: bool
    converged: bool = True
    held: float = float("nan")


class Tracker(Protocol):
    """A method: scans go in one by one, in the order of their stamps."""

    def track(self, scan: Scan) -> Tracked:
        """The scan's pose in the frame of the first scan; the map grows by it."""
        ...
