"""Odometry by voxelised GICP of each scan against the map of those before it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Scan
from jaxgeo.geometry.rigid import exp, log
from jaxgeo.odometry.motion import Motion
from jaxgeo.odometry.registration import PreparedCloud
from jaxgeo.odometry.scan_map import VOXELS, Match, ScanMap
from jaxgeo.odometry.settings import OdometrySettings
from jaxgeo.odometry.start import straightened, voxel_of
from jaxgeo.odometry.tracked import Tracked

BETTER = 0.8  # another start must cost so much less: along a tunnel all starts fit alike, and the motion model decides
STEADY = 1.5  # times the usual cost: beyond it other starts are tried
POOR = 0.75  # times the usual inlier share: below it a fan of starts is tried
FAN_RAD = (0.2, 0.4)
MEMORY = 0.9  # of the running means
LEAST_SHARE = 0.1  # of the points that must find the map in any case
PATIENCE = 3  # lost scans kept out of the map before a new piece is begun


class GicpTracker:
    """The map, the motion, and what scans usually cost."""

    def __init__(self, settings: OdometrySettings, first: Sequence[Scan]) -> None:
        """`first`: the first scans, from which the scale of the voxels and the velocity at the start are taken."""
        self._settings = settings
        self._map = ScanMap(voxel_of(first, settings), settings)
        self._motion: Motion | None = None
        self._first_twist = self._twist_at_start(first) if settings.deskew else None
        self._usual: Match | None = None
        self._lost_in_a_row = 0

    def track(self, scan: Scan) -> Tracked:
        """The scan's pose in the frame of the first scan; the map grows by it."""
        if self._motion is None:
            self._motion = Motion(scan.stamp_s, np.eye(4), self._first_twist)
            self._map.insert(self._map.prepare(straightened(scan, self._first_twist)), np.eye(4))
            return Tracked(np.eye(4), 1.0, 0.0, 0.0, False)
        cloud = self._map.prepare(straightened(scan, self._twist()))
        found = self._best_match(cloud, self._motion, scan.stamp_s)
        # Of the points where the map reaches: a sensor that turns to what it has not seen yet is not lost
        lost = found.inlier_share < max(self._settings.min_inlier_share * found.mapped_share, LEAST_SHARE)
        deviation_m, deviation_rad = self._motion.deviation(scan.stamp_s, found.T_map_lidar)
        self._motion = self._motion.after(scan.stamp_s, found.T_map_lidar)
        self._remember(found, lost)
        if not lost or self._lost_in_a_row > PATIENCE:
            self._map.insert(cloud, found.T_map_lidar)
        return Tracked(
            found.T_map_lidar, found.inlier_share, deviation_m, deviation_rad, lost, found.converged, found.held
        )

    def _best_match(self, cloud: PreparedCloud, motion: Motion, stamp_s: float) -> Match:
        """The match from the expected pose, or from another start where that one fits clearly better."""
        expected, sigma, usual = motion.T_map_lidar @ motion.step(stamp_s), self._sigma(motion, stamp_s), self._usual
        best = self._map.match(cloud, expected, sigma)
        if usual is not None and best.cost < STEADY * usual.cost:
            return best
        starts = _other_motions(motion, expected)
        if best.inlier_share < POOR * (usual.inlier_share if usual else 1.0):
            starts += _fan(expected, VOXELS[0] * self._map.voxel_m)
        scout = self._map.thinned(cloud)  # tries many starts in the time of one
        likely = min((self._map.match(scout, start, sigma) for start in starts), key=lambda match: match.cost)
        other = self._map.match(cloud, likely.T_map_lidar, sigma)
        return other if other.cost < BETTER * best.cost else best

    def _sigma(self, motion: Motion, stamp_s: float) -> Float[np.ndarray, "6"]:
        return motion.sigma(stamp_s, (self._settings.acceleration_m_s2, self._settings.acceleration_rad_s2))

    def _remember(self, found: Match, lost: bool) -> None:
        self._lost_in_a_row = self._lost_in_a_row + 1 if lost else 0
        if lost:
            return
        old = self._usual or found
        self._usual = dataclasses.replace(
            found,
            cost=MEMORY * old.cost + (1.0 - MEMORY) * found.cost,
            inlier_share=MEMORY * old.inlier_share + (1.0 - MEMORY) * found.inlier_share,
        )

    def _twist(self) -> Float[np.ndarray, "6"] | None:
        return self._motion.twist if self._motion is not None and self._settings.deskew else None

    def _twist_at_start(self, first: Sequence[Scan]) -> Float[np.ndarray, "6"] | None:
        """The velocity between the first two scans, both as crooked as they came: the first is straightened with it."""
        if first[0].time_s is None or len(first) < 2:
            return None
        start = GicpTracker(dataclasses.replace(self._settings, deskew=False), first[:1])
        start.track(first[0])
        step = start.track(first[1])
        return None if step.lost else log(step.T_map_lidar) / (first[1].stamp_s - first[0].stamp_s)


def _other_motions(motion: Motion, expected: Float[np.ndarray, "4 4"]) -> list[Float[np.ndarray, "4 4"]]:
    """Standing still, and going on without turning: what a hand-held sensor does when it turns back."""
    straight = expected.copy()
    straight[:3, :3] = motion.T_map_lidar[:3, :3]
    return [motion.T_map_lidar, straight]


def _fan(expected: Float[np.ndarray, "4 4"], shift_m: float) -> list[Float[np.ndarray, "4 4"]]:
    """Turned about the sensor's upright and cross axis, and shifted along its level ones."""
    tangents = [np.eye(6)[axis] * sign * angle for axis in (5, 4) for angle in FAN_RAD for sign in (1.0, -1.0)]
    tangents += [np.eye(6)[axis] * sign * shift_m for axis in (0, 1) for sign in (0.5, 1.0, -0.5, -1.0)]
    return [expected @ exp(tangent) for tangent in tangents]
