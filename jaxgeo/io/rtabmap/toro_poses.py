"""Poses of a TORO graph: `VERTEX3 id x y z roll pitch yaw`, or in the plane `VERTEX2 id x y yaw`."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.row_stamps import row_stamps
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.text_table import float_columns, table_of_rows

VERTICES = {"VERTEX3": 8, "VERTEX2": 5}
"""Tag to number of fields, the tag included."""


def read_toro_poses(path: str | Path, *, times: str | Path | None = None, rate_hz: float | None = None) -> Trajectory:
    """Read the poses of a TORO graph in the order of their ids; vertices with negative ids are landmarks, not poses.

    The angles are RTAB-Map's: R = Rz(yaw) Ry(pitch) Rx(roll). Edges are skipped.

    Args:
        path: the graph.
        times: file with one stamp in seconds a row, in the order of ids; or
        rate_hz: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: with file and line: no or repeated vertices, both kinds, wrong fields or numbers; no stamps.
    """
    lines = read_lines(path, TrajectoryError)
    tags = [(line.split(maxsplit=1) or ("",))[0] for line in lines]
    found = sorted(set(tags) & set(VERTICES))
    if len(found) != 1:
        what = "no VERTEX3 or VERTEX2 record" if not found else "records of both VERTEX3 and VERTEX2"
        raise TrajectoryError(f"{path}: {what}; expected a TORO graph of one kind. Is the format another one?")
    number = [i for i, tag in enumerate(tags) if tag == found[0]]
    table = table_of_rows(path, [lines[i] for i in number], np.array(number) + 1, delimiter=None, error=TrajectoryError)
    if table.n_columns != VERTICES[found[0]]:
        raise TrajectoryError(
            f"{table.place(0)}: {table.n_columns} fields, expected the {VERTICES[found[0]]} of a {found[0]} record."
        )
    values = float_columns(table, range(1, table.n_columns))
    ids = values[:, 0]
    order = np.argsort(ids, kind="stable")
    repeated = np.flatnonzero(np.diff(ids[order]) == 0)
    if len(repeated):
        first, second = sorted(order[repeated[0] : repeated[0] + 2])
        raise TrajectoryError(
            f"{table.place(second)}: vertex {ids[second]:g} repeats line {table.line[first]}; expected unique ids."
        )
    order = order[ids[order] >= 0]
    values = values[order]
    if found == ["VERTEX2"]:
        zero = np.zeros(len(values))
        values = np.column_stack([values[:, :3], zero, zero, zero, values[:, 3]])
    quat_wxyz = Rotation.from_euler("ZYX", values[:, [6, 5, 4]]).as_quat(scalar_first=True)
    stamp_s = row_stamps(path, len(order), times=times, rate_hz=rate_hz)
    return validated_trajectory(path, table.line[order], stamp_s, values[:, 1:4], quat_wxyz)
