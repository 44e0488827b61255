"""Poses of a NumPy file: (n, 4, 4) or (n, 3, 4), as KISS-ICP writes its `_poses.npy`; no stamps."""

from pathlib import Path

import numpy as np

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.pose_matrices import check_poses, pose_parts
from jaxgeo.io.regular_file import MOST_BYTES, check_regular
from jaxgeo.io.row_stamps import row_stamps

_LAST_ROW_TOLERANCE = 1e-9


def read_npy_poses(path: str | Path, *, times: str | Path | None = None, rate_hz: float | None = None) -> Trajectory:
    """Read a `.npy` file of body poses `T_map_body`.

    Args:
        path: the array; its first pose is called line 1 in messages.
        times: file with one stamp in seconds a row; or
        rate_hz: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: no NumPy file, another shape, numbers that are not finite, no rotations; no stamps.
    """
    poses = _array(path)
    check_poses(poses, lambda row: f"{path}: pose {row + 1}", TrajectoryError)
    if poses.shape[1] == 4:
        off = np.abs(poses[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1, initial=0.0)
        if (off > _LAST_ROW_TOLERANCE).any():
            row = int(np.argmax(off > _LAST_ROW_TOLERANCE))
            raise TrajectoryError(
                f"{path}: pose {row + 1}: the last row is {poses[row, 3].tolist()}, expected [0, 0, 0, 1]. Are the "
                "matrices transposed?"
            )
    position_m, quat_wxyz = pose_parts(poses)
    stamp_s = row_stamps(path, len(poses), times=times, rate_hz=rate_hz)
    return validated_trajectory(path, np.arange(1, len(poses) + 1), stamp_s, position_m, quat_wxyz)


def _array(path: str | Path) -> np.ndarray:
    check_regular(path, TrajectoryError)
    try:
        # Mapped, not read: a header that announces more than the file holds is refused before memory is asked for.
        stored = np.load(path, mmap_mode="r", allow_pickle=False)
    except FileNotFoundError:
        raise TrajectoryError(f"{path}: no such file. Check the path (in a config: relative to the config).") from None
    except IsADirectoryError:
        raise TrajectoryError(f"{path}: is a folder, expected a .npy file. Name the file in it.") from None
    except Exception as failure:  # of a damaged head: ValueError, EOFError, TokenError, SyntaxError, ...
        why = " ".join(str(failure).split())[:120]
        raise TrajectoryError(f"{path}: is no whole NumPy array (.npy): {why}. Is it of another format?") from None
    if not isinstance(stored, np.ndarray):
        raise TrajectoryError(f"{path}: is an archive (.npz), expected one array (.npy). Save the poses alone.")
    if stored.ndim != 3 or stored.shape[1:] not in ((4, 4), (3, 4)) or stored.dtype.kind not in "fiu":
        raise TrajectoryError(
            f"{path}: an array {stored.shape} of {stored.dtype}; expected (n, 4, 4) or (n, 3, 4) numbers: a pose each."
        )
    check_regular(path, TrajectoryError, MOST_BYTES)
    return np.array(stored, dtype=np.float64)
