"""Trajectories from files, whatever their format."""

import functools
from collections.abc import Callable
from pathlib import Path

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.euroc import read_euroc
from jaxgeo.io.g2o_poses import read_g2o_poses
from jaxgeo.io.kitti import read_kitti
from jaxgeo.io.npy_poses import read_npy_poses
from jaxgeo.io.rtabmap.pose_export import FLAVOURS, read_rtabmap_poses
from jaxgeo.io.tum import read_indexed_tum, read_tum

_STAMPED = {"tum": read_tum, "euroc": read_euroc}
_UNSTAMPED: dict[str, Callable[..., Trajectory]] = {
    "kitti": read_kitti,
    "g2o": read_g2o_poses,
    "npy": read_npy_poses,
    "tum-index": read_indexed_tum,
    "rtabmap": read_rtabmap_poses,
    **{f"rtabmap-{flavour}": functools.partial(read_rtabmap_poses, flavour=flavour) for flavour in FLAVOURS},
}
FORMATS = (*_STAMPED, *_UNSTAMPED)


def read_trajectory(
    path: str | Path, format: str, *, times: str | Path | None = None, rate_hz: float | None = None
) -> Trajectory:
    """Read a trajectory.

    Args:
        path: the file.
        format: one of `FORMATS`: `tum`, `euroc`, `kitti`, `g2o`; `npy` (KISS-ICP's `_poses.npy`); `tum-index` (TUM
            whose first column counts frames, as KISS-ICP writes for scans without stamps); `rtabmap` (the flavour as
            the file says) or `rtabmap-FLAVOUR` (see `read_rtabmap_poses`).
        times: formats without stamps: file with one stamp in seconds a row; or
        rate_hz: formats without stamps: poses a second, the first at stamp 0.

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
