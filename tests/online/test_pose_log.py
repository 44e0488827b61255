"""The log's columns are the chain that the batch job makes of the same poses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from solve.chain_session import session

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.graph.chain import chain_of
from jaxgeo.online.pose_log import PoseLog
from jaxgeo.online.warm_start import LastSolution, carried_on, padded_chain

N = 100


def turned_much() -> Trajectory:
    """Standing still, half turns and nearly whole ones, quaternions of either sign."""
    rng = np.random.default_rng(5)
    turn = Rotation.from_rotvec(rng.uniform(-1.0, 1.0, (N, 3)) * rng.choice([0.0, 1e-9, 1e-3, 1.0, 3.0], (N, 1)))
    quat = turn.as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], (N, 1))
    position = 1e4 + np.cumsum(rng.choice([0.0, 1.0], (N, 1)) * rng.standard_normal((N, 3)), axis=0)
    return Trajectory(np.arange(N) * 0.1, position, quat)


def logged(trajectory: Trajectory, capacity: int = 128) -> PoseLog:
    log = PoseLog(capacity)
    for row in zip(trajectory.stamp_s, trajectory.position_m, trajectory.quat_wxyz, strict=True):
        log.push(*row)
    return log


def chain_of_log(log: PoseLog):
    return padded_chain(jnp.array(log.columns), jnp.asarray(len(log)), jnp.asarray(log.origin_m))


@pytest.mark.parametrize("trajectory", [session(N).trajectory, turned_much()], ids=["walk", "turned much"])
def test_the_chain_is_the_batch_chain(trajectory):
    ours, batch = chain_of_log(logged(trajectory)), chain_of(trajectory)
    for part in ("length_m", "turn_rad", "odometry", "start"):
        for a, b in zip(jax.tree.leaves(getattr(ours, part)), jax.tree.leaves(getattr(batch, part)), strict=True):
            if part == "start":
                continue  # about another origin: below
            assert_allclose(a, b, atol=1e-9)
    for axis in range(3):
        assert_allclose(
            ours.start.t[axis] + ours.map_origin_m[axis], batch.start.t[axis] + batch.map_origin_m[axis], atol=1e-9
        )
    assert_allclose(jnp.stack(ours.start.quat), jnp.stack(batch.start.quat), atol=1e-12)


def test_what_it_grows_to_is_the_same():
    trajectory = session(N).trajectory
    log = PoseLog(32)
    for i in range(N):
        if len(log) == log.capacity:
            log.grow(2 * log.capacity)
        log.push(trajectory.stamp_s[i], trajectory.position_m[i], trajectory.quat_wxyz[i])
    assert log.capacity == 128
    assert np.array_equal(log.columns, logged(trajectory).columns)
    assert np.array_equal(log.trajectory().position_m, trajectory.position_m)


def test_a_full_log_says_so():
    log = logged(session(N).trajectory, N)
    with pytest.raises(TrajectoryError, match=r"pose 100: the log is full \(100 poses\)"):
        log.push(100.0, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    assert len(log) == N


def test_the_next_solve_starts_from_the_last_one_moved_on_rigidly():
    """A solution that is a similarity of the odometry is carried on as that similarity."""
    trajectory = session(N).trajectory
    chain = chain_of_log(logged(trajectory))
    scale, turn, shift = 1.3, Rotation.from_rotvec([0.3, -0.2, 1.0]), np.array([10.0, 20.0, -5.0])
    start_m = np.stack(chain.start.t, axis=1)
    moved_m = scale * turn.apply(start_m) + shift
    quat = (turn * Rotation.from_quat(np.stack(chain.start.quat, axis=1), scalar_first=True)).as_quat(scalar_first=True)
    count = 60
    known = np.minimum(np.arange(128), count - 1)
    poses = jax.tree.map(
        lambda _, c: jnp.asarray(c),
        chain.start,
        type(chain.start)(tuple(quat[known].T), tuple(moved_m[known].T)),
    )
    last = LastSolution(poses, jnp.asarray(count), jnp.array([100.0, 0.0, 0.0]), jnp.log(scale))
    found = carried_on(last, chain, jnp.array([90.0, 0.0, 1.0]))
    assert_allclose(np.stack(found.t, axis=1), moved_m + np.array([10.0, 0.0, -1.0]), atol=1e-9)
    same = np.abs(np.sum(np.stack(found.quat, axis=1) * quat, axis=1))
    assert_allclose(same, 1.0, atol=1e-12)
