"""What a solve is given: arrays of fixed size, and the last solution, carried on by the odometry since."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgeo.graph import soa
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain, Poses
from jaxgeo.online.pose_log import chain_of_columns


class Given(eqx.Module):
    """The poses and anchors so far.

    Attributes:
        columns: of the `PoseLog`, of which `count` are filled; `map_origin_m` has been subtracted from the positions.
        table: of the anchors, the last row padding that hangs on the last pose.
    """

    columns: Float[Array, "16 n"]
    count: Int[Array, ""]
    map_origin_m: Float[Array, "3"]
    table: AnchorTable


class LastSolution(eqx.Module):
    """What a solve leaves to the next one.

    Attributes:
        poses: of the padded chain, about `origin_m` of the local frame.
        count: poses that were there; the rest repeats the last.
    """

    poses: Poses
    count: Int[Array, ""]
    origin_m: Float[Array, "3"]
    log_scale: Float[Array, ""]


@jax.jit
def padded_chain(columns: Float[Array, "16 n"], count: Int[Array, ""], map_origin_m: Float[Array, "3"]) -> Chain:
    """What `chain_of` makes of the trajectory: the last pose repeated over the padding."""
    chain = chain_of_columns(columns, map_origin_m)
    last = count - 1
    there = jnp.arange(chain.length_m.shape[0]) <= last
    return eqx.tree_at(lambda c: c.start, chain, jax.tree.map(lambda c: jnp.where(there, c, c[last]), chain.start))


def chain_of_given(given: Given) -> Chain:
    return padded_chain(given.columns, given.count, given.map_origin_m)


def carried_on(last: LastSolution, chain: Chain, origin_m: Float[Array, "3"]) -> Poses:
    """The last solution about another origin, the poses since then as the scaled odometry has them."""
    n = chain.length_m.shape[0]
    at = last.count - 1
    start_q, start_t = jax.tree.map(lambda c: c[at], (chain.start.quat, chain.start.t))
    last_q, last_t = jax.tree.map(lambda c: c[at], (last.poses.quat, last.poses.t))
    turn = soa.quat_mul(last_q, soa.quat_conj(start_q))
    scale = jnp.exp(last.log_scale)
    quat = soa.quat_mul(turn, chain.start.quat)
    t = soa.add(last_t, soa.scale(scale, soa.rotate(turn, soa.sub(chain.start.t, start_t))))
    solved = jnp.arange(n) < last.count
    shift = last.origin_m - origin_m
    poses = jax.tree.map(lambda old, new: jnp.where(solved, old, new), last.poses, Poses(quat, t))
    return Poses(poses.quat, soa.add(poses.t, (shift[0], shift[1], shift[2])))
