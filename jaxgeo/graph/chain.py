"""The chain: a trajectory's own odometry edges, padded to a bucket, as component vectors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxgeo.data import Trajectory
from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.bucket import pose_bucket
from jaxgeo.graph.noise import LENGTH_FLOOR_M
from jaxgeo.graph.soa import Quat, Vec3


class Poses(eqx.Module):
    """Poses `T_grid_body` as component vectors of the padded length n."""

    quat: Quat
    t: Vec3


class Chain(eqx.Module):
    """Odometry of one trajectory. Edge k leads from pose k-1 to pose k; edge 0 and the padding have length 0.

    Attributes:
        odometry: relative motion of every edge, `T_(k-1) odometry_k = T_k` without noise.
        start: the poses as measured, map frame.
        length_m: (n,) distance of the edge, at least the standing-still floor; 0 for edge 0 and padding.
        turn_rad: (n,) turned angle of the edge.
        map_origin_m: (3,) what was subtracted from the measured positions, to keep numbers small.
    """

    odometry: Poses
    start: Poses
    length_m: Float[Array, "n"]
    turn_rad: Float[Array, "n"]
    map_origin_m: Float[Array, "3"]


def poses_of(position_m: np.ndarray, quat_wxyz: np.ndarray, padded: int) -> Poses:
    """Poses from (n, 3) and (n, 4) arrays, the last one repeated up to `padded`."""
    grow = ((0, padded - len(position_m)), (0, 0))
    p, q = np.pad(position_m, grow, mode="edge"), np.pad(quat_wxyz, grow, mode="edge")
    w, x, y, z, *t = (jnp.asarray(c) for c in (*q.T, *p.T))
    return Poses((w, x, y, z), (t[0], t[1], t[2]))


def previous(v: Array) -> Array:
    """The value of the pose before; pose 0 is its own predecessor, so that edge 0 is an identity."""
    return jnp.concatenate([v[:1], v[:-1]])


def relative_motion(before: Poses, here: Poses) -> Poses:
    """`before^-1 here`: the motion between them, in the frame of the first."""
    back = soa.quat_conj(before.quat)
    return Poses(soa.quat_mul(back, here.quat), soa.rotate(back, soa.sub(here.t, before.t)))


def chain_of(trajectory: Trajectory) -> Chain:
    """The odometry edges of a trajectory, padded to its bucket."""
    n = len(trajectory)
    padded = pose_bucket(n)
    origin = trajectory.position_m.mean(axis=0).round()
    start = poses_of(trajectory.position_m - origin, trajectory.quat_wxyz, padded)
    real = (np.arange(padded) > 0) & (np.arange(padded) < n)
    return _chain(start, real, origin)


@jax.jit
def _chain(start: Poses, real: Bool[Array, "n"], origin_m: Float[Array, "3"]) -> Chain:
    odometry = relative_motion(jax.tree.map(previous, start), start)
    step_t, step_r = se3_soa.log(odometry.quat, odometry.t)
    length = jnp.where(real, jnp.sqrt(soa.dot(step_t, step_t)) + LENGTH_FLOOR_M, 0.0)
    turn = jnp.where(real, jnp.sqrt(soa.dot(step_r, step_r)), 0.0)
    return Chain(odometry, start, length, turn, origin_m)
