"""LiDAR odometry: scans in, a drifting trajectory out. No loop closure."""

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Scan, Trajectory
from jaxgeo.errors import ScanError
from jaxgeo.geometry.rigid import inverse
from jaxgeo.odometry.doubts import doubts
from jaxgeo.odometry.gicp import GicpTracker
from jaxgeo.odometry.kiss import KissTracker
from jaxgeo.odometry.mid_sweep import centred, poses_at_stamps
from jaxgeo.odometry.scan_checks import checked_scans
from jaxgeo.odometry.settings import OdometrySettings
from jaxgeo.odometry.start import voxel_of
from jaxgeo.odometry.tracked import Tracked, Tracker

TRACKERS: dict[str, Callable[[OdometrySettings, Sequence[Scan]], Tracker]] = {"gicp": GicpTracker, "kiss": KissTracker}
FIRST = 10  # scans from which the scale of the scene is taken


@dataclasses.dataclass(frozen=True)
class Odometry:
    """A trajectory from scans, and how far each of its poses is to be trusted.

    Attributes:
        trajectory: `T_map_body` at the scans' stamps; the map frame is the body frame of the first scan.
        inlier_share: (n,) share of the scan's thinned points that found the map.
        deviation_m, deviation_rad: (n,) from the pose that the motion before foretold.
        lost: (n,) the scan did not find the map; its pose is a guess.
        seconds: (n,) of computing.
        voxel_m: of the finest map.
        warnings: sentences about stretches to be doubted.
    """

    trajectory: Trajectory
    inlier_share: Float[np.ndarray, "n"]
    deviation_m: Float[np.ndarray, "n"]
    deviation_rad: Float[np.ndarray, "n"]
    lost: Bool[np.ndarray, "n"]
    seconds: Float[np.ndarray, "n"]
    voxel_m: float
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.lost)


def estimate_odometry(
    scans: Iterable[Scan],
    settings: OdometrySettings = OdometrySettings(),  # noqa: B008  (frozen)
    T_body_lidar: Float[np.ndarray, "4 4"] | None = None,
    on_scan: Callable[[Scan, Tracked], None] | None = None,
) -> Odometry:
    """The trajectory of a moving LiDAR, each scan matched with the map of those before it.

    Args:
        scans: in the order of time; read one by one, and let go.
        settings: one set of defaults serves all sensors; see `OdometrySettings`.
        T_body_lidar: the sensor's pose in the body; default: the body is the sensor.
        on_scan: called after each scan, for a progress bar.

    Raises:
        ScanError: fewer than two scans, a scan with too few points, stamps that do not increase.
        InputError: the library of the method is not installed.
    """
    coming = ((scan, centred(scan) if settings.deskew else scan) for scan in checked_scans(scans, settings))
    first = list(itertools.islice(coming, FIRST))
    if len(first) < 2:
        raise ScanError(f"odometry: {len(first)} scan(s), expected two or more. Is this the right folder or topic?")
    tracker = TRACKERS[settings.method](settings, [middle for _, middle in first])
    stamps, middles, seconds, tracked = [], [], [], []
    for scan, middle in itertools.chain(first, coming):
        begun = time.perf_counter()
        tracked.append(tracker.track(middle))
        seconds.append(time.perf_counter() - begun)
        stamps.append(scan.stamp_s)
        middles.append(middle.stamp_s)
        if on_scan is not None:
            on_scan(scan, tracked[-1])
    stamp_s = np.array(stamps)
    return Odometry(
        _trajectory(
            stamp_s, poses_at_stamps(np.array(middles), [t.T_map_lidar for t in tracked], stamp_s), T_body_lidar
        ),
        np.array([t.inlier_share for t in tracked]),
        np.array([t.deviation_m for t in tracked]),
        np.array([t.deviation_rad for t in tracked]),
        np.array([t.lost for t in tracked]),
        np.array(seconds),
        voxel_of([scan for scan, _ in first], settings),
        doubts(stamp_s, tracked),
    )


def _trajectory(
    stamp_s: Float[np.ndarray, "n"],
    T_map_lidar: Float[np.ndarray, "n 4 4"],
    T_body_lidar: Float[np.ndarray, "4 4"] | None,
) -> Trajectory:
    """The body's poses in the frame of its first one: `T_body_lidar T_map_lidar T_body_lidar^-1`."""
    T = T_map_lidar if T_body_lidar is None else T_body_lidar @ T_map_lidar @ inverse(T_body_lidar)
    return Trajectory(stamp_s, T[:, :3, 3].copy(), Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True))
