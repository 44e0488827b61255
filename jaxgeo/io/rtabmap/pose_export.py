"""The text files that RTAB-Map exports poses to: six flavours, all read to ROS axes (x forward, z up).

RTAB-Map's number of each, and what it writes (six decimals):

| flavour | number | row | axes |
|---|---|---|---|
| raw | 0 | r11 r12 r13 tx r21 ... tz | ROS |
| rgbd-slam | 1 | stamp x y z qx qy qz qw | world and body changed: O^-1 W^-1 T O |
| kitti | 2 | r11 r12 r13 tx r21 ... tz | both optical: O^-1 T O |
| toro | 3 | VERTEX3 id x y z roll pitch yaw | ROS |
| g2o | 4 | VERTEX_SE3:QUAT id x y z qx qy qz qw | ROS |
| tum | 10, 11 | stamp x y z qx qy qz qw [id] | ROS |

O turns optical axes (x right, y down, z forward) to ROS axes; W is half a turn about x + z.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.g2o_poses import VERTEX, read_g2o_poses
from jaxgeo.io.kitti import read_kitti
from jaxgeo.io.rtabmap.toro_poses import VERTICES, read_toro_poses
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.tum import read_tum

OPTICAL_TO_ROS = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
RGBD_SLAM_WORLD = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])

_STAMPED = ("rgbd-slam", "tum")
_UNSTAMPED = {"raw": read_kitti, "kitti": read_kitti, "toro": read_toro_poses, "g2o": read_g2o_poses}
FLAVOURS = ("raw", "rgbd-slam", "kitti", "toro", "g2o", "tum")
_G2O_TAGS = (VERTEX, "PARAMS_SE3OFFSET")


def read_rtabmap_poses(
    path: str | Path,
    flavour: str | None = None,
    *,
    times: str | Path | None = None,
    rate_hz: float | None = None,
) -> Trajectory:
    """Read poses that RTAB-Map exported, in ROS axes; landmarks (negative ids) are left out.

    Args:
        path: the file.
        flavour: one of `FLAVOURS`; None: as the file says. Rows of 8 and of 12 numbers do not say which of two
            flavours they are of.
        times: raw, kitti, toro and g2o: file with one stamp in seconds a row, in the order of ids; or
        rate_hz: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: an unknown or unclear flavour, stamps given twice or not at all, or what the format's reader
            refuses.
    """
    if flavour is None:
        flavour = _recognised(path)
    if flavour in _STAMPED:
        if times is not None or rate_hz is not None:
            raise TrajectoryError(f"{path}: flavour {flavour} has its own stamps; remove `times` and `rate_hz`.")
        trajectory = read_tum(path)
    elif flavour in _UNSTAMPED:
        trajectory = _UNSTAMPED[flavour](path, times=times, rate_hz=rate_hz)
    else:
        raise TrajectoryError(f"{path}: unknown flavour {flavour!r} of RTAB-Map poses, expected {', '.join(FLAVOURS)}.")
    if flavour == "kitti":
        return _turned(trajectory, OPTICAL_TO_ROS)
    if flavour == "rgbd-slam":
        return _turned(trajectory, RGBD_SLAM_WORLD @ OPTICAL_TO_ROS)
    return trajectory


def _turned(trajectory: Trajectory, world: np.ndarray) -> Trajectory:
    """`world T O^-1`: other world axes, and a body in ROS axes in the place of one in optical axes."""
    rotation = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    turned = Rotation.from_matrix(world) * rotation * Rotation.from_matrix(OPTICAL_TO_ROS).inv()
    return Trajectory(trajectory.stamp_s, trajectory.position_m @ world.T, turned.as_quat(scalar_first=True))


def _recognised(path: str | Path) -> str:
    lines = read_lines(path, TrajectoryError)
    words = next((line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")), [])
    if words and words[0] in VERTICES:
        return "toro"
    if words and words[0] in _G2O_TAGS:
        return "g2o"
    if len(words) == 9:
        return "tum"
    if len(words) == 8:
        raise TrajectoryError(
            f"{path}: 8 columns are RTAB-Map's format 10 (ROS axes) or 1 (RGBD-SLAM's axes), and the file does not say "
            "which. Name the flavour: tum or rgbd-slam. The viewer's 'RGBD-SLAM in ROS coordinate frame' is tum."
        )
    if len(words) == 12:
        raise TrajectoryError(
            f"{path}: 12 columns are RTAB-Map's format 0 (ROS axes) or 2 (KITTI: optical axes), and the file does not "
            "say which. Name the flavour: raw or kitti."
        )
    raise TrajectoryError(
        f"{path}: {len(words)} columns in the first row; expected poses exported by RTAB-Map: 8, 9 or 12 numbers, or "
        "a TORO or g2o graph. Is it another kind of file?"
    )
