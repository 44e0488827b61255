"""KITTI trajectories: the rows of [R | t], 12 numbers a pose, no stamps."""

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.input_warning import RoundedInputWarning
from jaxgeo.io.pose_matrices import rotation_faults
from jaxgeo.io.row_stamps import row_stamps
from jaxgeo.io.text_table import TextTable, float_columns, read_table

ROTATION_TOLERANCE = 5e-3  # of R R^T - 1: three decimals
ROTATION_SILENT = 5e-6  # six decimals give up to 2e-6


def read_kitti(path: str | Path, *, times: str | Path | None = None, rate_hz: float | None = None) -> Trajectory:
    """Read a KITTI trajectory: rows r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz.

    Args:
        path: the poses.
        times: file with one stamp in seconds a row; or
        rate_hz: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: with file and line: wrong columns, numbers or rotations; no stamps; counts that differ.
    """
    table = read_table(path, error=TrajectoryError)
    if table.n_columns != 12:
        raise TrajectoryError(
            f"{table.place(0)}: {table.n_columns} columns, expected the 12 of a KITTI trajectory: the rows of [R | "
            "t]. Is the format another one (TUM: 8 columns)?"
        )
    poses = float_columns(table, range(12)).reshape(-1, 3, 4)
    stamp_s = row_stamps(path, len(table), times=times, rate_hz=rate_hz)
    quat_wxyz = _quaternions(table, poses[:, :, :3])
    return validated_trajectory(path, table.line, stamp_s, poses[:, :, 3], quat_wxyz)


def write_kitti(path: str | Path, trajectory: Trajectory, *, times: str | Path | None = None) -> None:
    """Write a KITTI trajectory, all digits; the stamps go to `times`, or are lost where it is None."""
    rotation = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True).as_matrix()
    rows = np.concatenate([rotation, trajectory.position_m[:, :, None]], axis=2).reshape(-1, 12)
    write_lines(path, (" ".join(map(repr, row)) for row in rows.tolist()))
    if times is not None:
        write_lines(times, map(repr, trajectory.stamp_s.tolist()))


def _quaternions(table: TextTable, matrix: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 4"]:
    """The nearest rotations, as quaternions wxyz."""
    off, mirrored = rotation_faults(matrix)
    wrong = (off > ROTATION_TOLERANCE) | mirrored
    if wrong.any():
        row = int(np.argmax(wrong))
        problem = (
            f"R R^T is off the identity by {off[row]:.3g}, expected at most {ROTATION_TOLERANCE:g}"
            if off[row] > ROTATION_TOLERANCE
            else "R is a reflection (determinant -1), expected a rotation"
        )
        raise TrajectoryError(
            f"{table.place(row)}: {problem}. Are the numbers the rows of [R | t] (r11 r12 r13 tx r21 ...), without "
            "a scale?"
        )
    if (off > ROTATION_SILENT).any():
        warnings.warn(
            f"{table.path}: rotation matrices are off orthonormal by up to {off.max():.1e}: the file was written "
            "with few decimals. The nearest rotations are used; write at least six decimals.",
            RoundedInputWarning,
            stacklevel=3,
        )
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
