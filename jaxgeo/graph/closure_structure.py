"""What the edges of a large graph say before any number is looked at: its stretches, its joints, a tree.

Worked out once, in NumPy, padded to buckets: another graph of about the size reuses the compiled programs.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from jaxgeo.graph.bucket import pose_bucket
from jaxgeo.graph.closure_levels import Coarsest, Level, coarser_levels, edge_bucket, grown, node_bucket


class Stretches(eqx.Module):
    """Runs of odometry between two joints; a pose whose only edges are its two odometry edges is no joint.

    Attributes:
        edge: (s,) the edges on stretches, along them; past the end for padding.
        sign: (s,) 1 where the edge is measured along its stretch, -1 against it, 0 for padding.
        stretch: (s,) the stretch it belongs to.
        pose: (s,) the pose at the edge's far end; past the end for padding.
        start: (q,) the first row of every stretch.
        joint_from: (q,) joint that a stretch leaves.
    """

    edge: Int[Array, "s"]
    sign: Float[Array, "s"]
    stretch: Int[Array, "s"]
    pose: Int[Array, "s"]
    start: Int[Array, "q"]
    joint_from: Int[Array, "q"]


class Structure(eqx.Module):
    """Which poses and edges the linear solver sees: joints, tied by direct edges and by stretches.

    Attributes:
        tree: (m,) 1 for the edges of a spanning tree, odometry first.
        stretches: what is eliminated in closed form, or None.
        direct_edge: (d,) edges between joints; past the end for padding.
        joint: (j,) poses that are joints; past the end for padding.
        first, second: (d + q,) joints tied by direct edges, then by stretches, padded.
        levels, coarsest: ever coarser graphs of the joints.
    """

    tree: Float[Array, "m"]
    stretches: Stretches | None
    direct_edge: Int[Array, "d"]
    joint: Int[Array, "j"]
    first: Int[Array, "e"]
    second: Int[Array, "e"]
    levels: tuple[Level, ...]
    coarsest: Coarsest


def odometry_edges(first: Int[np.ndarray, "m"], second: Int[np.ndarray, "m"]) -> Bool[np.ndarray, "m"]:
    """Edges between successive poses, measured forwards or backwards."""
    return np.abs(second - first) == 1


def spanning_tree(n: int, first: Int[np.ndarray, "m"], second: Int[np.ndarray, "m"]) -> Bool[np.ndarray, "m"]:
    """Edges of a spanning tree, odometry preferred; of several between the same poses the first."""
    low, high = np.minimum(first, second), np.maximum(first, second)
    pairs, row = np.unique(low * n + high, return_index=True)
    cost = np.where(odometry_edges(first, second)[row], 1.0, 2.0)
    tree = minimum_spanning_tree(coo_array((cost, (pairs // n, pairs % n)), shape=(n, n)).tocsr()).tocoo()
    chosen = np.zeros(len(first), bool)
    chosen[row[np.isin(pairs, tree.row.astype(np.int64) * n + tree.col)]] = True
    return chosen


def structure_of(
    n: int,
    first: Int[np.ndarray, "m"],
    second: Int[np.ndarray, "m"],
    definite: Bool[np.ndarray, "m"],
    strength: Float[np.ndarray, "m"],
) -> Structure:
    """The structure of a connected graph.

    Args:
        n: its poses.
        first, second: poses that its edges tie.
        definite: edges whose information can be inverted; only those can lie on stretches.
        strength: in (0, 1], how much an edge is to be believed when poses are grouped; 1 for odometry.
    """
    low, high = np.minimum(first, second), np.maximum(first, second)
    along = odometry_edges(first, second)
    degree = np.bincount(np.concatenate([first, second]), minlength=n)
    usable = along & definite
    before, behind = np.bincount(high[usable], minlength=n), np.bincount(low[usable], minlength=n)
    inner = (degree == 2) & (before == 1) & (behind == 1)
    inner[0] = False
    joint_of = np.cumsum(~inner) - 1
    on_stretch = along & (inner[low] | inner[high])
    stretches, ties, along_stretch = _stretches(
        n, low, high, first < second, np.flatnonzero(on_stretch), inner, joint_of
    )
    direct = np.flatnonzero(~on_stretch)
    d = edge_bucket(len(direct)) if len(direct) else 0
    joint_first = np.concatenate([grown(joint_of[first[direct]], d), ties[0]])
    joint_second = np.concatenate([grown(joint_of[second[direct]], d), ties[1]])
    joint = np.flatnonzero(~inner)
    tie_strength = np.concatenate([grown(strength[direct], d), along_stretch])
    levels, coarsest = coarser_levels(len(joint), joint_first, joint_second, tie_strength)
    m = pose_bucket(len(first))
    return Structure(
        jnp.asarray(grown(spanning_tree(n, first, second).astype(float), m)),
        stretches,
        jnp.asarray(grown(direct, d, m)),
        jnp.asarray(grown(joint, node_bucket(len(joint)), pose_bucket(n))),
        jnp.asarray(joint_first),
        jnp.asarray(joint_second),
        levels,
        coarsest,
    )


def _stretches(
    n: int,
    low: Int[np.ndarray, "m"],
    high: Int[np.ndarray, "m"],
    forwards: Bool[np.ndarray, "m"],
    rows: Int[np.ndarray, "s"],
    inner: Bool[np.ndarray, "n"],
    joint_of: Int[np.ndarray, "n"],
) -> tuple[Stretches | None, tuple[np.ndarray, np.ndarray], Float[np.ndarray, "q"]]:
    """The stretches, the joints at both their ends, and how strongly they tie them."""
    if not len(rows):
        nothing = np.zeros(0, int)
        return None, (nothing, nothing), np.zeros(0)
    rows = rows[np.argsort(low[rows])]
    begins = ~inner[low[rows]]
    start = np.flatnonzero(begins)
    length = np.diff(np.append(start, len(rows)))
    q, s, m = edge_bucket(len(start)), pose_bucket(len(rows)), pose_bucket(len(low))
    joint_from, joint_to = grown(joint_of[low[rows[start]]], q), grown(joint_of[high[rows[start + length - 1]]], q)
    stretches = Stretches(
        jnp.asarray(grown(rows, s, m)),
        jnp.asarray(grown(np.where(forwards, 1.0, -1.0)[rows], s)),
        jnp.asarray(grown(np.cumsum(begins) - 1, s, q)),
        jnp.asarray(grown(high[rows], s, pose_bucket(n))),
        jnp.asarray(grown(start, q)),
        jnp.asarray(joint_from),
    )
    return stretches, (joint_from, joint_to), grown(1.0 / length, q)
