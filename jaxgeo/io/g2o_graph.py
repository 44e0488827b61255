"""Pose graphs of g2o files: `VERTEX_SE3:QUAT` poses and the `EDGE_SE3:QUAT` relative poses between them.

An edge's 21 numbers are the upper triangle of its information matrix, row by row, (translation, rotation). The format's
own residual takes the rotation as a quaternion's vector part, half the angle, which would make the information of an
angle a quarter of what is written. GTSAM reads the numbers as they are, and so does this reader: the optima that are
published for the usual data sets rest on it.
"""

import dataclasses
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import RelativePoses
from jaxgeo.errors import GraphError
from jaxgeo.io.atomic import write_lines
from jaxgeo.io.checks import check_finite, check_size, unit_quaternions
from jaxgeo.io.g2o_poses import VERTEX, is_whole_number, pose_vertices, record_tags, whole_numbers
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.text_table import TextTable, float_columns, table_of_rows

EDGE = "EDGE_SE3:QUAT"
_FIX = "FIX"
_UPPER = np.triu_indices(6)
_EDGE_FIELDS = "id id x y z qx qy qz qw and 21 numbers of information"


@dataclasses.dataclass(frozen=True)
class G2oGraph:
    """A graph as the file has it; n poses in the order of their ids.

    Attributes:
        id: n ids.
        position_m, quat_wxyz: (n, 3), (n, 4) the start values.
        edges: rows are those of the poses.
        fixed: rows of the poses that the file holds fixed.
    """

    id: tuple[int, ...]
    position_m: Float[np.ndarray, "n 3"]
    quat_wxyz: Float[np.ndarray, "n 4"]
    edges: RelativePoses
    fixed: Int[np.ndarray, "f"]


def read_g2o_graph(path: str | Path) -> G2oGraph:
    """Read a g2o pose graph; landmarks (RTAB-Map's among them) and whatever else it holds are skipped, with a warning.

    Raises:
        GraphError: with file and line: no vertices or edges, wrong columns or numbers, repeated or unknown ids.
    """
    lines = read_lines(path, GraphError)
    vertices = pose_vertices(path, lines, GraphError)
    check_finite(path, vertices.line, np.column_stack([vertices.position_m, vertices.quat_wxyz]), GraphError)
    check_size(path, vertices.line, vertices.position_m, GraphError)
    quat_wxyz = unit_quaternions(path, vertices.line, vertices.quat_wxyz, GraphError)
    row = {number: i for i, number in enumerate(vertices.id)}
    tags = record_tags(lines)
    edges = _edges(path, lines, tags, row)
    fixed = [
        row[number] for i, tag in enumerate(tags) if tag == _FIX for number in _fixed_ids(path, i + 1, lines[i], row)
    ]
    skipped = Counter(tag for tag in tags if tag and tag[0] != "#" and tag not in (VERTEX, EDGE, _FIX))
    if vertices.n_landmarks:
        skipped[f"{VERTEX} of landmarks"] = vertices.n_landmarks
    if skipped:
        found = ", ".join(f"{tag[:40]} ({count})" for tag, count in skipped.most_common(10))
        warnings.warn(
            f"{path}: records that are no part of a pose graph were skipped: {found}.", InputWarning, stacklevel=2
        )
    return G2oGraph(vertices.id, vertices.position_m, quat_wxyz, edges, np.array(sorted(set(fixed)), dtype=int))


def write_g2o_graph(path: str | Path, graph: G2oGraph) -> None:
    """Write a graph with all digits; its rows come back in the order of the ids."""
    write_lines(path, _records(graph))


def _records(graph: G2oGraph) -> Iterator[str]:
    poses = np.column_stack([graph.position_m, graph.quat_wxyz[:, [1, 2, 3, 0]]]).tolist()
    for number, pose in zip(graph.id, poses, strict=True):
        yield f"{VERTEX} {number} {' '.join(map(repr, pose))}"
    for i in graph.fixed.tolist():
        yield f"{_FIX} {graph.id[i]}"
    edges = graph.edges
    upper = edges.information[:, *_UPPER]
    numbers = np.column_stack([edges.t_m, edges.quat_wxyz[:, [1, 2, 3, 0]], upper]).tolist()
    for first, second, row in zip(edges.first.tolist(), edges.second.tolist(), numbers, strict=True):
        yield f"{EDGE} {graph.id[first]} {graph.id[second]} {' '.join(map(repr, row))}"


def _edges(path: str | Path, lines: list[str], tags: list[str], row: dict[int, int]) -> RelativePoses:
    number = [i for i, tag in enumerate(tags) if tag == EDGE]
    if not number:
        raise GraphError(f"{path}: no {EDGE} record: poses alone are no graph. To read them, see `read_g2o_poses`.")
    table = table_of_rows(path, [lines[i] for i in number], np.array(number) + 1, delimiter=None, error=GraphError)
    if table.n_columns != 31:
        raise GraphError(f"{table.place(0)}: {table.n_columns} fields, expected the 31 of {EDGE} {_EDGE_FIELDS}.")
    ends = [_rows_of(table, column, row) for column in (1, 2)]
    values = float_columns(table, range(3, 31))
    quat_wxyz = unit_quaternions(path, table.line, values[:, [6, 3, 4, 5]], GraphError)
    information = np.zeros((len(table), 6, 6))
    information[:, *_UPPER] = values[:, 7:]
    information[:, _UPPER[1], _UPPER[0]] = values[:, 7:]
    return RelativePoses(ends[0], ends[1], np.ascontiguousarray(values[:, :3]), quat_wxyz, information)


def _rows_of(table: TextTable, column: int, row: dict[int, int]) -> Int[np.ndarray, "m"]:
    numbers = whole_numbers(table, column, "edge's vertex")
    for i, number in enumerate(numbers):
        if number not in row:
            raise GraphError(
                f"{table.place(i)}: vertex {number} is not in the file; expected an id of a {VERTEX} record."
            )
    return np.array([row[number] for number in numbers])


def _fixed_ids(path: str | Path, line: int, text: str, row: dict[int, int]) -> list[int]:
    words = text.split()[1:]
    if not words or not all(is_whole_number(word) and int(word) in row for word in words):
        raise GraphError(f"{path}:{line}: {text[:40]!r}, expected {_FIX} followed by ids of {VERTEX} records.")
    return [int(word) for word in words]
