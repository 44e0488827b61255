"""Odometry by KISS-ICP. kiss_icp lives here.

Vizzo et al., "KISS-ICP: In Defense of Point-to-Point ICP", RA-L 2023.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from jaxgeo.data import Scan
from jaxgeo.errors import InputError
from jaxgeo.geometry.rigid import apply
from jaxgeo.odometry.motion import Motion
from jaxgeo.odometry.settings import OdometrySettings
from jaxgeo.odometry.start import straightened, voxel_of
from jaxgeo.odometry.tracked import Tracked

VOXEL = 2.0  # times the finest voxel of the other method: about its own default, a hundredth of the range, outdoors
FARTHEST_M = 100.0  # its own default


class KissTracker:
    """KISS-ICP's own map, threshold and registration; deskewing and uneven stamps are ours."""

    def __init__(self, settings: OdometrySettings, first: Sequence[Scan]) -> None:
        """`first`: the first scans, from which the scale of the voxels is taken.

        Raises:
            InputError: kiss_icp is not installed.
        """
        self._settings = settings
        self._voxel_m = VOXEL * voxel_of(first, settings)
        self._icp = _kiss_icp(self._voxel_m, settings)
        self._motion: Motion | None = None

    def track(self, scan: Scan) -> Tracked:
        """The scan's pose in the frame of the first scan; the map grows by it."""
        if self._motion is None:
            self._motion = Motion(scan.stamp_s, np.eye(4))
            self._icp.register_frame(np.ascontiguousarray(scan.points_m, dtype=np.float64), np.empty(0))
            return Tracked(np.eye(4), 1.0, 0.0, 0.0, False)
        twist = self._motion.twist if self._settings.deskew else None
        points_m = np.ascontiguousarray(straightened(scan, twist), dtype=np.float64)
        before = np.array(self._icp.local_map.point_cloud())
        step = self._motion.step(scan.stamp_s)
        self._icp.last_delta = step  # its own takes stamps for even
        _, source = self._icp.register_frame(points_m, np.empty(0))
        T = np.array(self._icp.last_pose)
        distance_m, _ = KDTree(before).query(apply(T, np.asarray(source)), distance_upper_bound=self._voxel_m)
        share = float(np.mean(np.isfinite(distance_m)))
        deviation_m, deviation_rad = self._motion.deviation(scan.stamp_s, T)
        self._motion = self._motion.after(scan.stamp_s, T)
        return Tracked(T, share, deviation_m, deviation_rad, share < self._settings.min_inlier_share)


def _kiss_icp(voxel_m: float, settings: OdometrySettings) -> Any:
    try:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP
    except ImportError as failure:
        raise InputError(
            f"odometry by `kiss` needs kiss_icp, which cannot be imported ({failure}): pip install 'jaxgeo[cloud]', or "
            "take the method `gicp`."
        ) from None
    config = KISSConfig()
    config.data.deskew = False
    config.data.max_range = settings.max_range_m or FARTHEST_M
    config.mapping.voxel_size = voxel_m
    config.registration.max_num_threads = settings.threads
    return KissICP(config)
