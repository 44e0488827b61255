"""Trajectories from files, whatever their format."""

from pathlib import Path

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.euroc import read_euroc
from jaxgeo.io.g2o_poses import read_g2o_poses
from jaxgeo.io.kitti import read_kitti
from jaxgeo.io.tum import read_tum

_STAMPED = {"tum": read_tum, "euroc": read_euroc}
_UNSTAMPED = {"kitti": read_kitti, "g2o": read_g2o_poses}
FORMATS = (*_STAMPED, *_UNSTAMPED)


def read_trajectory(
    path: str | Path, format: str, *, times: str | Path | None = None, rate_hz: float | None = None
) -> Trajectory:
    """Read a trajectory.

    Args:
        path: the file.
        format: `tum`, `euroc`, `kitti` or `g2o`.
        times: kitti and g2o: file with one stamp in seconds a row; or
        rate_hz: kitti and g2o: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: an unknown format, stamps given twice, or what the format's reader refuses.
    """
    if format in _UNSTAMPED:
        return _UNSTAMPED[format](path, times=times, rate_hz=rate_hz)
    if format not in _STAMPED:
        raise TrajectoryError(f"{path}: unknown trajectory format {format!r}, expected one of {', '.join(FORMATS)}.")
    if times is not None or rate_hz is not None:
        raise TrajectoryError(f"{path}: format {format} has its own stamps; remove `times` and `rate_hz`.")
    return _STAMPED[format](path)
