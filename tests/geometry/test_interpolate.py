import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from random_poses import random_tangents
from scipy.spatial.transform import Rotation, Slerp

from jaxgeo.data import Trajectory
from jaxgeo.errors import SightingError
from jaxgeo.geometry import interpolate_poses, poses_at, se3_exp, se3_parts

START_S = 1_600_000_000.0


def trajectory(n: int = 6, kind: str = "tangent_normal") -> Trajectory:
    position, quat = se3_parts(se3_exp(jnp.asarray(random_tangents(kind, (n,)))))
    stamp_s = START_S + np.cumsum(np.random.default_rng(1).uniform(0.05, 0.5, n))
    return Trajectory(stamp_s, np.asarray(position), np.asarray(quat))


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
def test_rotation_is_slerp_and_the_screw_ends_at_the_poses(shares):
    run = trajectory()
    query_s = np.clip(run.stamp_s[0] + np.array(shares) * np.ptp(run.stamp_s), run.stamp_s[0], run.stamp_s[-1])
    found = poses_at(run, query_s)
    slerp = Slerp(run.stamp_s - START_S, Rotation.from_quat(run.quat_wxyz, scalar_first=True))(query_s - START_S)
    turn = Rotation.from_quat(found.quat_wxyz, scalar_first=True)
    assert_allclose((slerp.inv() * turn).magnitude(), 0.0, atol=1e-11)
    assert (run.stamp_s[found.index] <= query_s).all()
    assert (query_s <= run.stamp_s[found.index + 1]).all()
    assert ((found.fraction >= 0.0) & (found.fraction <= 1.0)).all()


def test_at_the_stamps_the_poses_themselves():
    run = trajectory()
    found = poses_at(run, run.stamp_s)
    assert_allclose(found.position_m, run.position_m, atol=1e-13)
    assert_allclose(np.abs(np.sum(found.quat_wxyz * run.quat_wxyz, axis=1)), 1.0, atol=1e-14)
    assert_array_equal(found.index, [0, 1, 2, 3, 4, 4])
    assert_allclose(found.fraction, [0, 0, 0, 0, 0, 1])


def test_screw_motion_goes_along_the_arc():
    """A quarter circle of radius 1 about the origin: half-way lies on the circle, not on its chord."""
    quarter = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    run = Trajectory(np.array([0.0, 1.0]), np.array([[1.0, 0, 0], [0, 1.0, 0]]), np.array([[1.0, 0, 0, 0], quarter]))
    found = poses_at(run, np.array([1.0 / 3.0]))
    assert_allclose(found.position_m[0], [np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0], atol=1e-15)


def test_sign_of_a_quaternion_does_not_matter():
    run = trajectory()
    flipped = Trajectory(run.stamp_s, run.position_m, run.quat_wxyz * np.array([1, -1, 1, -1, -1, 1.0])[:, None])
    query_s = run.stamp_s[:-1] + 0.3 * np.diff(run.stamp_s)
    assert_allclose(poses_at(flipped, query_s).position_m, poses_at(run, query_s).position_m, atol=1e-13)


def test_traced_core_is_the_boundary_function():
    run = trajectory(9)
    query_s = np.random.default_rng(0).uniform(run.stamp_s[0], run.stamp_s[-1], 37)
    traced = jax.jit(interpolate_poses)(*map(jnp.asarray, (run.stamp_s, run.position_m, run.quat_wxyz, query_s)))
    for ours, theirs in zip(poses_at(run, query_s), traced, strict=True):
        assert_allclose(ours, theirs, atol=1e-14)


def test_derivative_by_the_query_is_the_velocity():
    """A clock offset is estimated through this; still also at a pose that equals its neighbour."""
    stamp_s = jnp.arange(4.0)
    position = jnp.asarray([[0.0, 0, 0], [2.0, 0, 0], [2.0, 0, 0], [2.0, 3.0, 0]])
    quat = jnp.asarray(np.tile([1.0, 0, 0, 0], (4, 1)))
    query_s = jnp.array([0.5, 1.5, 2.5])
    velocity = jax.jit(jax.jacfwd(lambda offset_s: interpolate_poses(stamp_s, position, quat, query_s + offset_s)[0]))
    assert_allclose(velocity(0.0), [[2.0, 0, 0], [0, 0, 0], [0, 3.0, 0]], atol=1e-14)


@pytest.mark.parametrize(
    ("offset_s", "hint"), [(-0.3, "clock offset"), (+0.3, "clock offset"), (1e6, "epochs"), (-1.5e9, "epochs")]
)
def test_never_extrapolates(offset_s, hint):
    run = trajectory()
    edge = run.stamp_s[0] if offset_s < 0 else run.stamp_s[-1]
    with pytest.raises(SightingError, match=hint) as caught:
        poses_at(run, np.array([run.stamp_s[1], edge + offset_s]), np.array(["tags.csv:2", "tags.csv:3"]))
    message = str(caught.value)
    assert message.startswith(f"tags.csv:3: stamp {edge + offset_s:.6f} s is outside the trajectory")
    assert f"{run.stamp_s[0]:.6f} to {run.stamp_s[-1]:.6f}" in message
    assert "1 of 2" in message


def test_a_stamp_that_is_no_number():
    with pytest.raises(SightingError, match="not a number"):
        poses_at(trajectory(), np.array([np.nan]))


def test_one_pose_is_not_enough():
    with pytest.raises(SightingError, match="1 pose"):
        poses_at(trajectory(1), np.array([START_S]))


def test_no_query():
    assert poses_at(trajectory(), np.zeros(0)).position_m.shape == (0, 3)
