"""TUM trajectories: `stamp x y z qx qy qz qw`, blanks, `#` comments.

RTAB-Map's format 11 adds a ninth column, the node id; its landmarks have negative ids and are no poses.
"""

from pathlib import Path

import numpy as np

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.row_stamps import row_stamps
from jaxgeo.io.text_table import TextTable, float_columns, read_table


def read_tum(path: str | Path) -> Trajectory:
    """Read a TUM trajectory; stamps in seconds, quaternions xyzw on disk.

    Raises:
        TrajectoryError: with file and line, as in `validated_trajectory`, or for a wrong number of columns.
    """
    table = read_table(path, error=TrajectoryError)
    if table.n_columns not in (8, 9):
        raise TrajectoryError(
            f"{table.place(0)}: {table.n_columns} columns, expected the 8 of a TUM trajectory: stamp x y z qx qy qz qw "
            "(a ninth may hold a node id). Is the format another one (KITTI: 12 columns)?"
        )
    values = float_columns(table, range(table.n_columns))
    line = table.line
    if table.n_columns == 9:
        keep = _node_ids(table, values[:, 8]) >= 0
        values, line = values[keep], line[keep]
    return validated_trajectory(path, line, values[:, 0], values[:, 1:4], values[:, [7, 4, 5, 6]])


def read_indexed_tum(path: str | Path, *, times: str | Path | None = None, rate_hz: float | None = None) -> Trajectory:
    """Read a TUM trajectory whose first column counts frames 0, 1, 2, ... (KISS-ICP writes it so without stamps).

    Args:
        path: the trajectory.
        times: file with one stamp in seconds a row; or
        rate_hz: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: as `read_tum`; the first column does not count frames; no stamps.
    """
    trajectory = read_tum(path)
    wrong = trajectory.stamp_s != np.arange(len(trajectory))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise TrajectoryError(
            f"{path}: pose {row + 1} has {float(trajectory.stamp_s[row])!r} in the first column; expected {row}: the "
            "count of frames from 0. Are these stamps? Then the format is tum."
        )
    stamp_s = row_stamps(path, len(trajectory), times=times, rate_hz=rate_hz)
    return Trajectory(stamp_s, trajectory.position_m, trajectory.quat_wxyz)


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write a TUM trajectory with all digits of float64: reading it back gives the same numbers."""
    rows = np.column_stack([trajectory.stamp_s, trajectory.position_m, trajectory.quat_wxyz[:, [1, 2, 3, 0]]])
    write_lines(path, (" ".join(map(repr, row)) for row in rows.tolist()))


def _node_ids(table: TextTable, column: np.ndarray) -> np.ndarray:
    wrong = column != np.round(column)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise TrajectoryError(
            f"{table.place(row)}: ninth column holds {column[row]:g}; expected a whole node id, or 8 columns: stamp "
            "x y z qx qy qz qw."
        )
    return column
