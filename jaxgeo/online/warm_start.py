"""The chain of fixed size, and where its next solve starts: the last solution, carried on by the odometry since."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxgeo.graph import soa
from jaxgeo.graph.chain import Chain, Poses
from jaxgeo.online.pose_log import LENGTH, START_Q, START_T, STEP_Q, STEP_T, TURN


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
def chain_of_columns(columns: Float[Array, "16 n"], count: Int[Array, ""], origin_m: Float[Array, "3"]) -> Chain:
    """The chain of a `PoseLog`'s columns, of which `count` are filled: what `chain_of` makes of the trajectory."""
    real = jnp.arange(columns.shape[1]) < count
    start = jnp.where(
        real[None], columns[START_T.start : START_Q.stop], columns[START_T.start : START_Q.stop, count - 1][:, None]
    )
    step = columns[STEP_T.start : STEP_Q.stop]
    return Chain(_poses(step), _poses(start), columns[LENGTH], columns[TURN], origin_m)


def _poses(rows: Float[Array, "7 n"]) -> Poses:
    return Poses((rows[3], rows[4], rows[5], rows[6]), (rows[0], rows[1], rows[2]))


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
