"""A planned path as the drift sees it: how every component of the noise adds up along it, anywhere on it.

A plan has no noise yet, so `jaxgeo.solve.drift`'s prefix sums need no solution to be linearised at: an edge's noise n_k
moves every later pose by `Ad(T_k) n_k`. They are taken at knots along the path and interpolated between these, as if
an edge's noise were spread evenly over it. So prior covariances are continuous, and differentiable, in the place along
the path and in the noise.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.graph.chain import Chain, Poses, chain_of
from jaxgeo.graph.components import WANDER_ROT, WANDER_SCALE, WANDER_TRANS, NoiseEnsemble
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.pose_graph import AnchorRows, PoseGraph, Terms, zero_globals
from jaxgeo.solve.drift import BLOCKS, Drift, drift_at
from jaxgeo.solve.linearise import edges_at

MOST_KNOTS = 2048
# No edge is longer than this share of the path: waypoints may be far apart.
LONGEST_EDGE = 1.0 / 256.0
# Knots of a leg that is added to a path.
EXTENSION = 32


class Plan(eqx.Module):
    """A path at n knots, and the influence of unit noise on them. Places are real knot numbers, 0 .. n-1.

    Attributes:
        position_m: (n, 3) local frame, about whose origin the influences are.
        stamp_s, distance_m: (n,) time, and way along the path.
        pose: (n,) number of the path's pose, once `densified`.
        white: (7, n, 6, 6) covariance of each white component, summed up to the knot.
        constant: (n, 6, 8) influence of each constant.
        block_end: (b,) places where the stretches end on which a wandering bias is constant.
        wanders: whether a noise that wanders is asked about; without, less is computed.
    """

    position_m: Float[Array, "n 3"]
    stamp_s: Float[Array, "n"]
    distance_m: Float[Array, "n"]
    pose: Int[Array, "n"]
    white: Float[Array, "7 n 6 6"]
    constant: Float[Array, "n 6 8"]
    block_end: Float[Array, "b"]
    wanders: bool = eqx.field(static=True)

    def __len__(self) -> int:
        return self.distance_m.shape[0]


def plan_of(path: Trajectory, *, wanders: bool = True, most_knots: int = MOST_KNOTS) -> Plan:
    """Sum up a path's drift.

    Args:
        path: planned, or of an earlier session, in the local frame; it may be a few waypoints.
        wanders: see `Plan`.
        most_knots: at most so many poses are kept, evenly along the path.

    Raises:
        TrajectoryError: fewer than two poses, or no motion.
    """
    _check(path)
    path = densified(path)
    way = _way_m(path)
    even = np.linspace(0.0, way[-1], min(len(path), most_knots))
    return _plan_at(path, np.unique(np.clip(np.searchsorted(way, even), 0, len(path) - 1)), wanders)


def extended_plan(path: Trajectory, point_m: Float[np.ndarray, "3"], plan: Plan) -> Plan:
    """The plan of a path that goes on, straight, from its end to a point: `EXTENSION` more knots.

    Args:
        plan: of the same path; places on it are the same places of the longer one.
    """
    _check(path)
    path = densified(path)
    last = path.position_m[-1]
    share = np.arange(1, EXTENSION + 1)[:, None] / EXTENSION
    leg = point_m - last
    heading = np.array([0.0, 0.0, np.arctan2(leg[1], leg[0])])
    turn = Rotation.from_rotvec(np.tile(heading, (EXTENSION, 1))).as_quat(scalar_first=True)
    pace_s = (path.stamp_s[-1] - path.stamp_s[0]) * np.linalg.norm(leg) / _way_m(path)[-1]
    longer = Trajectory(
        np.concatenate([path.stamp_s, path.stamp_s[-1] + np.maximum(pace_s, 1e-3) * share[:, 0]]),
        np.concatenate([path.position_m, last + share * leg]),
        np.concatenate([path.quat_wxyz, turn]),
    )
    knots = np.asarray(plan.pose)
    return _plan_at(longer, np.concatenate([knots, len(path) + np.arange(EXTENSION)]), plan.wanders)


def _check(path: Trajectory) -> None:
    if len(path) < 2 or not np.ptp(path.position_m, axis=0).max() > 0.0:
        raise TrajectoryError(f"a path of {len(path)} pose(s) that goes nowhere: expected one that moves.")


def _way_m(path: Trajectory) -> Float[np.ndarray, "n"]:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.position_m, axis=0), axis=1))])


def _plan_at(path: Trajectory, knots: Int[np.ndarray, "k"], wanders: bool) -> Plan:
    drift = _drift_at(chain_of(path), jnp.asarray(knots))
    along = np.asarray(drift.distance_m)
    ends = np.arange(1, BLOCKS + 1) / BLOCKS * along[-1]
    return Plan(
        position_m=jnp.asarray(path.position_m[knots]),
        stamp_s=jnp.asarray(path.stamp_s[knots]),
        distance_m=drift.distance_m,
        pose=jnp.asarray(knots),
        white=drift.white,
        constant=drift.constant,
        block_end=jnp.asarray(np.interp(ends, along, np.arange(len(knots), dtype=float))),
        wanders=wanders,
    )


def wandering(noise: NoiseEnsemble) -> bool:
    """Whether any set of an ensemble has a component that wanders."""
    return bool(np.any(np.asarray(noise.sigma)[:, [WANDER_TRANS, WANDER_ROT, WANDER_SCALE]] > 0.0))


def densified(path: Trajectory) -> Trajectory:
    """Poses added evenly along edges that are long for the path."""
    step = np.linalg.norm(np.diff(path.position_m, axis=0), axis=1)
    parts = np.maximum(np.ceil(step / (LONGEST_EDGE * step.sum())), 1.0).astype(int)
    if parts.max() == 1:
        return path
    edge = np.repeat(np.arange(len(parts)), parts)
    share = np.concatenate([np.arange(p) / p for p in parts])
    turn = Rotation.from_quat(path.quat_wxyz, scalar_first=True)
    omega = (turn[:-1].inv() * turn[1:]).as_rotvec()
    between = Rotation.from_quat(path.quat_wxyz[edge], scalar_first=True) * Rotation.from_rotvec(
        share[:, None] * omega[edge]
    )

    def linear(x: np.ndarray) -> np.ndarray:
        f = share.reshape(-1, *(1,) * (x.ndim - 1))
        return np.concatenate([(1.0 - f) * x[edge] + f * x[edge + 1], x[-1:]])

    quat = np.concatenate([between.as_quat(scalar_first=True), path.quat_wxyz[-1:]])
    return Trajectory(linear(path.stamp_s), linear(path.position_m), quat)


def between_knots(values: Array, place: Float[Array, "p"], axis: int = 0) -> Array:
    """Values at real places, linear between the knots."""
    n = values.shape[axis]
    before = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0, n - 2).astype(int)
    shape = [1] * values.ndim
    shape[axis] = place.shape[0]
    share = (place - before.astype(float)).reshape(shape)
    return (1.0 - share) * jnp.take(values, before, axis=axis) + share * jnp.take(values, before + 1, axis=axis)


def position_at(plan: Plan, place: Float[Array, "p"]) -> Float[Array, "p 3"]:
    """Where the path is."""
    return between_knots(plan.position_m, place)


def place_at_distance(plan: Plan, distance_m: Float[Array, "p"]) -> Float[Array, "p"]:
    """The place so far along the path; beyond its ends, these."""
    return jnp.interp(distance_m, plan.distance_m, jnp.arange(len(plan)).astype(float))


def place_at_stamp(plan: Plan, stamp_s: Float[Array, "p"]) -> Float[Array, "p"]:
    """The place at a time; before and after the path, its ends."""
    return jnp.interp(stamp_s, plan.stamp_s, jnp.arange(len(plan)).astype(float))


@jax.jit
def _drift_at(chain: Chain, knots: Array) -> Drift:
    origin = chain.map_origin_m
    t = chain.start.t
    poses = Poses(chain.start.quat, (t[0] + origin[0], t[1] + origin[1], t[2] + origin[2]))
    graph = _without_anchors(chain, poses)
    zero = jnp.zeros_like(chain.length_m)
    nothing = ((zero, zero, zero), (zero, zero, zero))
    edges = edges_at(poses, nothing, zero_globals(), jnp.ones(()), graph)
    return drift_at(edges, graph, knots)


def _without_anchors(chain: Chain, poses: Poses) -> PoseGraph:
    """The graph that the drift is summed up along; its noise is not read."""
    three = jnp.zeros((0, 3, 3))
    none = AnchorRows(jnp.zeros(0, dtype=int), jnp.zeros(0, dtype=int), three[:, 0], three[:, 0], three, three, three)
    return PoseGraph(chain, none, odometry_noise(1.0, 1.0), poses, zero_globals(), jnp.ones(()), Terms(log_scale=True))
