"""What the sensors saw, fused along a trajectory."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from jaxtyping import Float

from jaxgeo.data import RgbdFrame, Scan, Trajectory
from jaxgeo.geometry import poses_at
from jaxgeo.geometry.rigid import matrices
from jaxgeo.mapping.fusion import FusedCloud, FusionSettings, PosedCloud, cloud_of_frame, fuse_points
from jaxgeo.mapping.placed_scans import placed_scans
from jaxgeo.mapping.rgbd_camera import RgbdCamera


def fuse_scans(
    scans: Iterable[Scan],
    trajectory: Trajectory,
    T_body_lidar: Float[np.ndarray, "4 4"],
    settings: FusionSettings,
    on_scan: Callable[[], None] | None = None,
) -> FusedCloud:
    """All scans inside the trajectory, straightened where their points carry times; `pose_index` is the pose before.

    Raises:
        CloudError: as `fuse_points`.
    """

    def clouds() -> Iterator[PosedCloud]:
        for placed in placed_scans(scans, trajectory, T_body_lidar):
            if on_scan is not None:
                on_scan()
            if placed.T_map_body is not None:
                scan = placed.scan
                pose = _pose_before(trajectory, scan.stamp_s)
                yield PosedCloud(scan.stamp_s, pose, placed.T_map_body, placed.points_body_m, None, scan.intensity)

    return fuse_points(clouds(), settings)


def fuse_frames(
    frames: Iterable[RgbdFrame],
    trajectory: Trajectory,
    camera: RgbdCamera,
    settings: FusionSettings,
    on_frame: Callable[[], None] | None = None,
) -> FusedCloud:
    """All RGB-D frames inside the trajectory, with their colours.

    Raises:
        CloudError: as `fuse_points`.
    """

    def clouds() -> Iterator[PosedCloud]:
        for frame, T_map_body in placed_frames(frames, trajectory):
            if on_frame is not None:
                on_frame()
            yield cloud_of_frame(frame, camera, T_map_body, _pose_before(trajectory, frame.stamp_s))

    return fuse_points(clouds(), settings)


def placed_frames(
    frames: Iterable[RgbdFrame], trajectory: Trajectory
) -> Iterator[tuple[RgbdFrame, Float[np.ndarray, "4 4"]]]:
    """The frames inside the trajectory with their body poses."""
    for frame in frames:
        if trajectory.stamp_s[0] <= frame.stamp_s <= trajectory.stamp_s[-1]:
            poses = poses_at(trajectory, np.array([frame.stamp_s]))
            yield frame, matrices(poses.position_m[0], poses.quat_wxyz[0])


def _pose_before(trajectory: Trajectory, stamp_s: float) -> int:
    return int(np.searchsorted(trajectory.stamp_s, stamp_s, side="right")) - 1
