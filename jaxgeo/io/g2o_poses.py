"""Poses of a g2o graph: `VERTEX_SE3:QUAT id x y z qx qy qz qw`; every other record is skipped."""

import dataclasses
import re
from collections import Counter
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError, TrajectoryError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.row_stamps import row_stamps
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.text_table import TextTable, float_columns, table_of_rows, text_column

VERTEX = "VERTEX_SE3:QUAT"
LANDMARK_EDGE = "EDGE_SE3"
_WHOLE_NUMBER = re.compile(r"-?[0-9]{1,30}")


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
    vertices = pose_vertices(path, read_lines(path, TrajectoryError), TrajectoryError)
    stamp_s = row_stamps(path, len(vertices.line), times=times, rate_hz=rate_hz)
    return validated_trajectory(path, vertices.line, stamp_s, vertices.position_m, vertices.quat_wxyz)


def write_g2o_poses(path: str | Path, trajectory: Trajectory) -> None:
    """Write the poses as vertices with ids 0, 1, ...; all digits, stamps are lost."""
    rows = np.column_stack([trajectory.position_m, trajectory.quat_wxyz[:, [1, 2, 3, 0]]]).tolist()
    write_lines(path, (f"{VERTEX} {i} {' '.join(map(repr, row))}" for i, row in enumerate(rows)))


@dataclasses.dataclass(frozen=True)
class PoseVertices:
    """Pose vertices in the order of their ids, landmarks left out; numbers as read.

    Attributes:
        id: n ids.
        line: (n,) their lines in the file.
        position_m, quat_wxyz: (n, 3), (n, 4).
        n_landmarks: how many were left out.
    """

    id: tuple[int, ...]
    line: Int[np.ndarray, "n"]
    position_m: Float[np.ndarray, "n 3"]
    quat_wxyz: Float[np.ndarray, "n 4"]
    n_landmarks: int


def pose_vertices(path: str | Path, lines: list[str], error: type[InputError]) -> PoseVertices:
    """The pose vertices among a g2o file's lines.

    Raises:
        error: with file and line: no or repeated vertices, wrong columns or numbers.
    """
    tags = record_tags(lines)
    number = [i for i, tag in enumerate(tags) if tag == VERTEX]
    if not number:
        found = ", ".join(f"{tag[:40]} ({count})" for tag, count in Counter(filter(None, tags)).most_common(5))
        raise error(
            f"{path}: no {VERTEX} record; found {found}. Only 3-D pose graphs can be read: is the format another one?"
        )
    table = table_of_rows(path, [lines[i] for i in number], np.array(number) + 1, delimiter=None, error=error)
    if table.n_columns != 9:
        raise error(f"{table.place(0)}: {table.n_columns} fields, expected the 9 of {VERTEX} id x y z qx qy qz qw.")
    ids = _vertex_ids(table)
    landmarks = {_landmark_id(path, i + 1, lines[i], error) for i, tag in enumerate(tags) if tag == LANDMARK_EDGE}
    order = sorted((i for i in range(len(ids)) if ids[i] not in landmarks), key=ids.__getitem__)
    values = float_columns(table, range(2, 9))[order]
    names = tuple(ids[i] for i in order)
    return PoseVertices(names, table.line[order], values[:, :3], values[:, [6, 3, 4, 5]], len(ids) - len(order))


def record_tags(lines: list[str]) -> list[str]:
    """The first word of every line; empty for blank ones."""
    return [(line.split(maxsplit=1) or ("",))[0] for line in lines]


def whole_numbers(table: TextTable, column: int, what: str) -> list[int]:
    """A column of ids as Python integers: GTSAM's keys exceed what float64 can tell apart.

    Raises:
        table.error: a cell is no whole number.
    """
    cells = text_column(table, column)
    for row, text in enumerate(cells):
        if not is_whole_number(text):
            raise table.error(f"{table.place(row)}: {what} id {text[:40]!r}, expected a whole number.")
    return [int(text) for text in cells]


def is_whole_number(text: str) -> bool:
    """Whether a word is an id: Latin digits, no more than any program writes."""
    return _WHOLE_NUMBER.fullmatch(text) is not None


def _vertex_ids(table: TextTable) -> list[int]:
    ids: dict[int, int] = {}
    for row, number in enumerate(whole_numbers(table, 1, "vertex")):
        if number in ids:
            raise table.error(
                f"{table.place(row)}: vertex {number} repeats line {table.line[ids[number]]}; expected unique ids."
            )
        ids[number] = row
    return list(ids)


def _landmark_id(path: str | Path, line: int, edge: str, error: type[InputError]) -> int:
    ends = edge.split()[1:3]
    if len(ends) < 2 or not all(map(is_whole_number, ends)):
        raise error(f"{path}:{line}: {edge[:40]!r}, expected {LANDMARK_EDGE} followed by two vertex ids.")
    return max(map(int, ends))
