"""What can be set about LiDAR odometry, with the one set of defaults meant for all sensors."""

import dataclasses
from typing import Literal

from jaxgeo.errors import InputError

Method = Literal["gicp", "kiss"]
METHODS: tuple[Method, ...] = ("gicp", "kiss")


@dataclasses.dataclass(frozen=True)
class OdometrySettings:
    """How scans are matched. Lengths that follow the scene are given as shares of its typical range.

    Attributes:
        method: `gicp`, voxelised GICP against a growing map; `kiss`, KISS-ICP.
        deskew: straighten scans whose points carry times.
        min_range_m, max_range_m: points nearer or farther are not used; None: no limit there.
        voxel_m: of the finest map; None: `voxel_share` of the first scans' typical range, within `voxel_limits_m`.
        voxel_share: see `voxel_m`; the plateau on which it lies is in docs/odometry.md.
        voxel_limits_m: see `voxel_m`.
        acceleration_m_s2, acceleration_rad_s2: how fast a velocity may change: the sigma of the motion model over an
            interval dt is this times dt^2, or what the recent scans showed where that is more.
        points_per_measurement: so many matched points count as one independent measurement beside the motion model:
            neighbouring points share their errors.
        min_inlier_share: a scan is lost if, of its points where the map reaches at all, fewer find the map.
        map_horizon: parts of the map not seen again for so many insertions are forgotten.
        threads: of the libraries. One is enough for most sensors, and gives the same digits every time.
    """

    method: Method = "gicp"
    deskew: bool = True
    min_range_m: float | None = None
    max_range_m: float | None = None
    voxel_m: float | None = None
    voxel_share: float = 0.05
    voxel_limits_m: tuple[float, float] = (0.1, 1.0)
    acceleration_m_s2: float = 3.0
    acceleration_rad_s2: float = 3.0
    points_per_measurement: float = 30.0
    min_inlier_share: float = 0.4
    map_horizon: int = 400
    threads: int = 1

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"odometry: method {self.method!r}, expected one of {', '.join(METHODS)}.")
        low, high = self.min_range_m or 0.0, self.max_range_m
        if low < 0.0 or (high is not None and high <= low):
            raise InputError(
                f"odometry: points from {low:g} m to {high if high is None else format(high, 'g')} m; expected "
                "0 <= min_range < max_range."
            )
        positive = ("voxel_m", "voxel_share", "acceleration_m_s2", "acceleration_rad_s2", "points_per_measurement")
        for name in (*positive, "min_inlier_share", "map_horizon", "threads"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"odometry: {name} is {value!r}, expected a positive number.")
