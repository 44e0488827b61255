"""The links of a database: measured motions between nodes, of several kinds."""

import dataclasses
import sqlite3

import numpy as np
from jaxtyping import Int

from jaxgeo.data import RelativePoses
from jaxgeo.errors import GraphError
from jaxgeo.io.pose_matrices import check_poses, pose_parts
from jaxgeo.io.rtabmap.blobs import blob, numbers, pose_blob
from jaxgeo.io.rtabmap.left_out import LeftOut

KINDS = (
    "neighbour",
    "global_closure",
    "local_space_closure",
    "local_time_closure",
    "user_closure",
    "virtual_closure",
    "neighbour_merged",
    "pose_prior",
    "landmark",
    "gravity",
)
"""By RTAB-Map's number of the type."""
_MEASURED = (0, 1, 2, 3, 4, 6)


@dataclasses.dataclass(frozen=True)
class RtabmapLinks:
    """Measured motions between two nodes, each once.

    Attributes:
        relative: `T_from_to`; `first` and `second` are rows of the nodes.
        kind: (m,) index into `KINDS`.
    """

    relative: RelativePoses
    kind: Int[np.ndarray, "m"]

    def __len__(self) -> int:
        return len(self.kind)


def read_links(connection: sqlite3.Connection, path: str, ids: Int[np.ndarray, "n"], left_out: LeftOut) -> RtabmapLinks:
    """All links that are measured motions between two nodes of `ids`.

    RTAB-Map stores most links a second time from the other end: these are not told twice. Left out and counted: priors,
    gravity and landmarks (not between two nodes), virtual closures (computed from the graph, not measured), links
    without a transform, of nodes that are not there, or with an unusable information matrix.

    The information is taken as of (translation, rotation), metres and radians, in the frame of the measured motion.

    Raises:
        GraphError: ids or types that are no whole numbers, transforms that are no poses.
        InputError: values of the wrong type or size.
    """
    row_of = {node: row for row, node in enumerate(ids.tolist())}
    seen: set[tuple[int, int, int]] = set()
    ends: list[tuple[int, int, int]] = []
    poses: list[np.ndarray] = []
    information: list[np.ndarray] = []
    query = "SELECT from_id, to_id, type, transform, information_matrix FROM Link ORDER BY from_id, to_id"
    for first, second, kind, transform, matrix in connection.execute(query):
        place = f"{path}: link {first} -> {second}"
        if not all(isinstance(value, int) for value in (first, second, kind)):
            raise GraphError(f"{place} of type {kind!r}; expected whole numbers.")
        name = KINDS[kind] if 0 <= kind < len(KINDS) else f"type_{kind}"
        if kind not in _MEASURED or first == second:
            left_out.add(f"{name} links", f"{place}: is no measured motion between two nodes")
            continue
        if first not in row_of or second not in row_of:
            left_out.add("links", f"{place}: node {second if first in row_of else first} is not there")
            continue
        if (second, first, kind) in seen:
            continue
        pose = pose_blob(transform, f"{place}: transform")
        if pose is None:
            left_out.add("links", f"{place}: has no transform")
            continue
        info = _information(matrix, f"{place}: information_matrix")
        if info is None:
            left_out.add("links", f"{place}: the information matrix is not positive definite")
            continue
        seen.add((first, second, kind))
        ends.append((row_of[first], row_of[second], kind))
        poses.append(pose)
        information.append(info)
    number = np.array(ends, dtype=np.int64).reshape(-1, 3)
    stacked = np.array(poses, dtype=np.float64).reshape(-1, 3, 4)
    check_poses(stacked, lambda row: f"{path}: link {ids[number[row, 0]]} -> {ids[number[row, 1]]}", GraphError)
    t_m, quat_wxyz = pose_parts(stacked)
    information_matrices = np.array(information, dtype=np.float64).reshape(-1, 6, 6)
    relative = RelativePoses(number[:, 0], number[:, 1], t_m, quat_wxyz, information_matrices)
    return RtabmapLinks(relative, number[:, 2])


def _information(value: object, place: str) -> np.ndarray | None:
    """The symmetric matrix; None where it is not finite and positive definite."""
    data = blob(value, place)
    if data is None:
        return None
    matrix = numbers(data, "<f8", 36, place).reshape(6, 6)
    matrix = 0.5 * (matrix + matrix.T)
    return matrix if np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix)[0] > 0 else None
