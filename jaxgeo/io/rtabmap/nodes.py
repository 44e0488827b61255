"""The nodes of a database: stamps, sessions, odometry, truth, GPS; and the poses that RTAB-Map's optimiser gave."""

import dataclasses
import math
import sqlite3
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.errors import InputError
from jaxgeo.io.checks import LARGEST_STAMP_S
from jaxgeo.io.pose_matrices import check_poses
from jaxgeo.io.rtabmap.blobs import blob, compressed_array, numbers, pose_blob
from jaxgeo.io.rtabmap.left_out import LeftOut

_INVALID_WEIGHT = -9  # RTAB-Map's mark of nodes that are not to be used


@dataclasses.dataclass(frozen=True)
class RtabmapNodes:
    """Nodes in the order of their ids; rows of NaN where a node has no such thing.

    Attributes:
        id: (n,) positive.
        map_id: (n,) the session: odometry frames differ from session to session.
        stamp_s: (n,) seconds.
        T_odom_body: (n, 3, 4) odometry.
        T_world_body: (n, 3, 4) ground truth.
        T_map_body: (n, 3, 4) optimised.
        gps: (n, 6) stamp_s, longitude and latitude in degrees (WGS84), altitude_m, accuracy_m, bearing in degrees from
            north, clockwise.
    """

    id: Int[np.ndarray, "n"]
    map_id: Int[np.ndarray, "n"]
    stamp_s: Float[np.ndarray, "n"]
    T_odom_body: Float[np.ndarray, "n 3 4"]
    T_world_body: Float[np.ndarray, "n 3 4"]
    T_map_body: Float[np.ndarray, "n 3 4"]
    gps: Float[np.ndarray, "n 6"]

    def __len__(self) -> int:
        return len(self.id)


def there(poses: Float[np.ndarray, "n 3 4"]) -> np.ndarray:
    """(n,) whether there is a pose."""
    return ~np.isnan(poses[:, 0, 0])


def read_nodes(connection: sqlite3.Connection, path: str, columns: tuple[str, ...], left_out: LeftOut) -> RtabmapNodes:
    """All nodes but those that RTAB-Map marked as invalid.

    Args:
        connection: read only.
        path: for messages.
        columns: those of `Node`; old databases have no `gps`.
        left_out: gets the nodes left out.

    Raises:
        InputError: values of the wrong type or size, poses that are none, stamps that are no seconds.
    """
    gps = "gps" if "gps" in columns else "NULL"
    query = f"SELECT id, map_id, weight, stamp, pose, ground_truth_pose, {gps} FROM Node ORDER BY id"
    ids: list[tuple[int, int]] = []
    stamps: list[float] = []
    poses: list[tuple[np.ndarray, np.ndarray]] = []
    fixes: list[np.ndarray] = []
    for node, map_id, weight, stamp, pose, truth, fix in connection.execute(query):
        place = f"{path}: node {node}"
        if not isinstance(node, int) or not isinstance(map_id, int) or node <= 0:
            raise InputError(f"{place}: map_id {map_id!r}; expected a positive whole id and a whole map_id.")
        if isinstance(weight, int) and weight <= _INVALID_WEIGHT:
            left_out.add("nodes", f"{place}: weight {weight} marks it as invalid")
            continue
        ids.append((node, map_id))
        stamps.append(_seconds(stamp, place))
        poses.append((_pose(pose, f"{place}: pose"), _pose(truth, f"{place}: ground_truth_pose")))
        fixes.append(_gps(fix, f"{place}: gps"))
    number = np.array(ids, dtype=np.int64).reshape(-1, 2)
    odometry, truth = np.array(poses, dtype=np.float64).reshape(-1, 2, 3, 4).swapaxes(0, 1)
    nothing = np.full_like(odometry, np.nan)
    return RtabmapNodes(
        number[:, 0], number[:, 1], np.array(stamps), odometry, truth, nothing, np.array(fixes).reshape(-1, 6)
    )


def with_optimised(nodes: RtabmapNodes, ids: Any, poses: Any, path: str, left_out: LeftOut) -> RtabmapNodes:
    """The nodes with the optimised poses of `Admin.opt_ids` and `opt_poses`; as they are where there are none.

    Ids below 0 are landmarks; other ids that are no node's are counted in `left_out`.

    Raises:
        InputError: one without the other, counts that differ, repeated ids, or poses that are none.
    """
    place = f"{path}: Admin.opt_poses"
    id_data, pose_data = blob(ids, f"{path}: Admin.opt_ids"), blob(poses, place)
    if id_data is None and pose_data is None:
        return nodes
    if id_data is None or pose_data is None:
        missing = "opt_ids" if id_data is None else "opt_poses"
        raise InputError(f"{path}: Admin.{missing} is missing, the other of opt_ids and opt_poses is there.")
    number = compressed_array(id_data, f"{path}: Admin.opt_ids").ravel()
    values = compressed_array(pose_data, place).ravel()
    if number.dtype != np.int32 or values.dtype != np.float32 or len(values) != 12 * len(number):
        raise InputError(
            f"{place}: {len(values)} numbers of {values.dtype} for {len(number)} ids of {number.dtype}; expected 12 "
            "float32 for each int32."
        )
    optimised = values.astype(np.float64).reshape(-1, 3, 4)
    check_poses(optimised, lambda row: f"{place}: node {number[row]}", InputError)
    if len(np.unique(number)) != len(number):
        raise InputError(f"{path}: Admin.opt_ids names a node twice; expected each once.")
    row_of = {node: row for row, node in enumerate(nodes.id.tolist())}
    T_map_body = np.full((len(nodes), 3, 4), np.nan)
    for node, pose in zip(number.tolist(), optimised, strict=True):
        if node in row_of:
            T_map_body[row_of[node]] = pose
        elif node < 0:
            left_out.add("optimised landmarks", f"{place}: landmark {node}")
        else:
            left_out.add("optimised poses", f"{place}: node {node} is not in the table of nodes")
    return dataclasses.replace(nodes, T_map_body=T_map_body)


def _seconds(stamp: Any, place: str) -> float:
    if isinstance(stamp, (int, float)) and math.isfinite(stamp) and abs(stamp) <= LARGEST_STAMP_S:
        return float(stamp)
    raise InputError(f"{place}: stamp {str(stamp)[:40]!r}; expected seconds. Is the database damaged, or very old?")


def _pose(value: Any, place: str) -> Float[np.ndarray, "3 4"]:
    pose = pose_blob(value, place)
    if pose is None:
        return np.full((3, 4), np.nan)
    check_poses(pose[None], lambda _: place, InputError)
    return pose


def _gps(value: Any, place: str) -> Float[np.ndarray, "6"]:
    data = blob(value, place)
    if data is None:
        return np.full(6, np.nan)
    fix = numbers(data, "<f8", 6, place)
    if not (np.isfinite(fix).all() and abs(fix[1]) <= 180 and abs(fix[2]) <= 90):
        raise InputError(f"{place}: {fix.tolist()}; expected stamp, longitude, latitude in degrees, and three numbers.")
    return fix if fix[0] else np.full(6, np.nan)
