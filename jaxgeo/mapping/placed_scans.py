"""Scans at the poses of a trajectory, straightened where their points carry times."""

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Scan, Trajectory
from jaxgeo.geometry import poses_at
from jaxgeo.geometry.rigid import adjoint, apply, inverse, log, matrices
from jaxgeo.odometry.deskew import deskewed


@dataclasses.dataclass(frozen=True)
class PlacedScan:
    """A scan in the body frame of its stamp; `T_map_body` None where the stamp lies outside the trajectory."""

    scan: Scan
    points_body_m: Float[np.ndarray, "n 3"]
    T_map_body: Float[np.ndarray, "4 4"] | None


def placed_scans(
    scans: Iterable[Scan], trajectory: Trajectory, T_body_lidar: Float[np.ndarray, "4 4"]
) -> Iterator[PlacedScan]:
    """One scan at a time. While a scan is taken the body moves evenly, as the trajectory says it did on the whole."""
    first_s, last_s = float(trajectory.stamp_s[0]), float(trajectory.stamp_s[-1])
    for scan in scans:
        if not first_s <= scan.stamp_s <= last_s:
            yield PlacedScan(scan, apply(T_body_lidar, scan.points_m), None)
            continue
        begin_s = end_s = scan.stamp_s
        if scan.time_s is not None and len(scan):
            begin_s = max(first_s, scan.stamp_s + float(scan.time_s.min()))
            end_s = min(last_s, scan.stamp_s + float(scan.time_s.max()))
        poses = poses_at(trajectory, np.array([scan.stamp_s, begin_s, end_s]))
        T = matrices(poses.position_m, poses.quat_wxyz)
        points = scan.points_m
        if scan.time_s is not None and end_s > begin_s:
            twist_body = log(inverse(T[1]) @ T[2]) / (end_s - begin_s)
            points = deskewed(points, scan.time_s, adjoint(inverse(T_body_lidar)) @ twist_body)
        yield PlacedScan(scan, apply(T_body_lidar, points), T[0])
