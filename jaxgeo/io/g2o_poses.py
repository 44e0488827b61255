"""Poses of a g2o graph: `VERTEX_SE3:QUAT id x y z qx qy qz qw`; every other record is skipped."""

from collections import Counter
from pathlib import Path

import numpy as np

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.row_stamps import row_stamps
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.text_table import TextTable, float_columns, table_of_rows, text_column

VERTEX = "VERTEX_SE3:QUAT"
LANDMARK_EDGE = "EDGE_SE3"


def read_g2o_poses(path: str | Path, *, times: str | Path | None = None, rate_hz: float | None = None) -> Trajectory:
    """Read the poses of a g2o file, in the order of their ids.

    RTAB-Map writes its landmarks as pose vertices too, numbered after the last pose and tied by `EDGE_SE3` (without
    `:QUAT`): these are left out.

    Args:
        path: the graph.
        times: file with one stamp in seconds a row, in the order of ids; or
        rate_hz: poses a second, the first at stamp 0.

    Raises:
        TrajectoryError: with file and line: no or repeated vertices, wrong columns or numbers; no stamps.
    """
    lines = read_lines(path, TrajectoryError)
    tags = [(line.split(maxsplit=1) or ("",))[0] for line in lines]
    number = [i for i, tag in enumerate(tags) if tag == VERTEX]
    if not number:
        found = ", ".join(f"{tag} ({count})" for tag, count in Counter(filter(None, tags)).most_common(5))
        raise TrajectoryError(
            f"{path}: no {VERTEX} record; found {found}. Only 3-D pose graphs can be read: is the format another one?"
        )
    rows = [lines[i] for i in number]
    table = table_of_rows(path, rows, np.array(number) + 1, delimiter=None, error=TrajectoryError)
    if table.n_columns != 9:
        raise TrajectoryError(
            f"{table.place(0)}: {table.n_columns} fields, expected the 9 of {VERTEX} id x y z qx qy qz qw."
        )
    ids = _vertex_ids(table)
    landmarks = {_landmark_id(path, i + 1, lines[i]) for i, tag in enumerate(tags) if tag == LANDMARK_EDGE}
    order = np.array(sorted((i for i in range(len(ids)) if ids[i] not in landmarks), key=ids.__getitem__), dtype=int)
    values = float_columns(table, range(2, 9))[order]
    stamp_s = row_stamps(path, len(order), times=times, rate_hz=rate_hz)
    return validated_trajectory(path, table.line[order], stamp_s, values[:, :3], values[:, [6, 3, 4, 5]])


def write_g2o_poses(path: str | Path, trajectory: Trajectory) -> None:
    """Write the poses as vertices with ids 0, 1, ...; all digits, stamps are lost."""
    rows = np.column_stack([trajectory.position_m, trajectory.quat_wxyz[:, [1, 2, 3, 0]]]).tolist()
    write_lines(path, (f"{VERTEX} {i} {' '.join(map(repr, row))}" for i, row in enumerate(rows)))


def _vertex_ids(table: TextTable) -> list[int]:
    """Ids as Python integers: GTSAM's keys exceed what float64 can tell apart."""
    ids: dict[int, int] = {}
    for row, text in enumerate(text_column(table, 1)):
        if not text.lstrip("-").isdecimal():
            raise TrajectoryError(f"{table.place(row)}: vertex id {text!r}, expected a whole number.")
        if int(text) in ids:
            raise TrajectoryError(
                f"{table.place(row)}: vertex {text} repeats line {table.line[ids[int(text)]]}; expected unique ids."
            )
        ids[int(text)] = row
    return list(ids)


def _landmark_id(path: str | Path, line: int, edge: str) -> int:
    ends = edge.split()[1:3]
    if len(ends) < 2 or not all(end.isdecimal() for end in ends):
        raise TrajectoryError(f"{path}:{line}: {edge[:40]!r}, expected {LANDMARK_EDGE} followed by two vertex ids.")
    return max(map(int, ends))
