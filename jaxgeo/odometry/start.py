"""Before scans are matched: the scale of the voxels, and each scan made straight."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Scan
from jaxgeo.odometry.deskew import deskewed
from jaxgeo.odometry.settings import OdometrySettings


def voxel_of(first: Sequence[Scan], settings: OdometrySettings) -> float:
    """The finest voxel in metres: a share of the median over these scans of the scan's median range."""
    if settings.voxel_m is not None:
        return settings.voxel_m
    range_m = np.median([np.median(np.linalg.norm(scan.points_m, axis=1)) for scan in first])
    return float(np.clip(settings.voxel_share * range_m, *settings.voxel_limits_m))


def straightened(scan: Scan, twist: Float[np.ndarray, "6"] | None) -> Float[np.ndarray, "n 3"]:
    """The scan's points as all seen at its stamp; as they came without times, or with no velocity known."""
    if scan.time_s is None or twist is None:
        return scan.points_m
    return deskewed(scan.points_m, scan.time_s, twist)
