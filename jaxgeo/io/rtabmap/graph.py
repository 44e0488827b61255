"""Trajectories and the pose graph of a database's nodes."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxgeo.data import RelativePoses, Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.pose_matrices import pose_parts
from jaxgeo.io.rtabmap.left_out import LeftOut
from jaxgeo.io.rtabmap.links import RtabmapLinks
from jaxgeo.io.rtabmap.nodes import RtabmapNodes, there


@dataclasses.dataclass(frozen=True)
class RtabmapGraph:
    """Nodes with their best poses, and the measured motions between them.

    Attributes:
        id, map_id: (k,) of the nodes.
        stamp_s: (k,) seconds.
        position_m, quat_wxyz: (k, 3), (k, 4) the best poses: see `best_poses`.
        optimised: (k,) whether RTAB-Map's optimiser gave the pose.
        relative: `first` and `second` are rows of this graph.
        kind: (m,) index into `links.KINDS`.
    """

    id: Int[np.ndarray, "k"]
    map_id: Int[np.ndarray, "k"]
    stamp_s: Float[np.ndarray, "k"]
    position_m: Float[np.ndarray, "k 3"]
    quat_wxyz: Float[np.ndarray, "k 4"]
    optimised: Bool[np.ndarray, "k"]
    relative: RelativePoses
    kind: Int[np.ndarray, "m"]


def trajectory_of(
    path: str, nodes: RtabmapNodes, poses: Float[np.ndarray, "n 3 4"], chosen: Bool[np.ndarray, "n"] | None = None
) -> Trajectory | None:
    """The poses that are there, in the order of time; None where there is none.

    Args:
        path: for messages.
        nodes: whose stamps.
        poses: rows of NaN where there is none.
        chosen: only these nodes.

    Raises:
        TrajectoryError: two of the nodes have one stamp.
    """
    rows = np.flatnonzero(there(poses) if chosen is None else there(poses) & chosen)
    if not len(rows):
        return None
    rows = rows[np.argsort(nodes.stamp_s[rows], kind="stable")]
    stamp_s = nodes.stamp_s[rows]
    same = np.flatnonzero(np.diff(stamp_s) == 0)
    if len(same):
        first, second = nodes.id[rows[same[0] : same[0] + 2]].tolist()
        raise TrajectoryError(
            f"{path}: nodes {first} and {second} have the stamp {stamp_s[same[0]]!r}; expected one node at a time. "
            "Were the images recorded without stamps, or is one session in the database twice?"
        )
    return Trajectory(stamp_s, *pose_parts(poses[rows]))


def odometry_by_session(path: str, nodes: RtabmapNodes) -> dict[int, Trajectory]:
    """The odometry of each session (map_id): every session has an odometry frame of its own.

    Raises:
        TrajectoryError: as `trajectory_of`.
    """
    found = {}
    for session in np.unique(nodes.map_id).tolist():
        trajectory = trajectory_of(path, nodes, nodes.T_odom_body, nodes.map_id == session)
        if trajectory is not None:
            found[session] = trajectory
    return found


def best_poses(path: str, nodes: RtabmapNodes, left_out: LeftOut) -> Float[np.ndarray, "n 3 4"]:
    """The optimised pose where there is one; otherwise the odometry, in the frame of the optimised ones.

    A node that the optimiser did not see is carried by the odometry of its session from the node nearest by id that it
    did see: T_map_body = T_map_near T_odom_near^-1 T_odom_body. Where nothing was optimised at all, every session stays
    in its own odometry frame. Rows of NaN where a node has no pose; those are counted in `left_out`.
    """
    best = nodes.T_map_body.copy()
    if not there(best).any():
        best = nodes.T_odom_body.copy()
    else:
        for session in np.unique(nodes.map_id[~there(best)]).tolist():
            within = nodes.map_id == session
            known = np.flatnonzero(within & there(nodes.T_map_body) & there(nodes.T_odom_body))
            open_rows = np.flatnonzero(within & ~there(nodes.T_map_body) & there(nodes.T_odom_body))
            if len(known) and len(open_rows):
                near = known[np.argmin(np.abs(nodes.id[known] - nodes.id[open_rows, None]), axis=1)]
                from_near = _product(_inverse(nodes.T_odom_body[near]), nodes.T_odom_body[open_rows])
                best[open_rows] = _product(nodes.T_map_body[near], from_near)
    without = np.flatnonzero(~there(best))
    if len(without):
        why = f"{path}: node {nodes.id[without[0]]}: neither an optimised pose nor odometry that leads to one"
        left_out.add("nodes of the graph", why, len(without))
    return best


def graph_of(path: str, nodes: RtabmapNodes, links: RtabmapLinks, left_out: LeftOut) -> RtabmapGraph:
    """The nodes that have a pose, with the links between them; the others are counted in `left_out`."""
    best = best_poses(path, nodes, left_out)
    rows = np.flatnonzero(there(best))
    new_row = np.full(len(nodes), -1)
    new_row[rows] = np.arange(len(rows))
    relative = links.relative
    both = np.flatnonzero((new_row[relative.first] >= 0) & (new_row[relative.second] >= 0))
    if len(both) < len(links):
        left_out.add("links", f"{path}: links of nodes that have no pose", len(links) - len(both))
    kept = relative.take(both)
    kept = dataclasses.replace(kept, first=new_row[kept.first], second=new_row[kept.second])
    position_m, quat_wxyz = pose_parts(best[rows])
    optimised = there(nodes.T_map_body)[rows]
    return RtabmapGraph(
        nodes.id[rows],
        nodes.map_id[rows],
        nodes.stamp_s[rows],
        position_m,
        quat_wxyz,
        optimised,
        kept,
        links.kind[both],
    )


def _inverse(poses: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, "n 3 4"]:
    turned = poses[:, :, :3].mT
    return np.concatenate([turned, -turned @ poses[:, :, 3:]], axis=2)


def _product(a: Float[np.ndarray, "n 3 4"], b: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, "n 3 4"]:
    moved = a[:, :, :3] @ b
    moved[:, :, 3] += a[:, :, 3]
    return moved
