import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from random_poses import KINDS, random_tangents

from jaxgeo.data import Trajectory
from jaxgeo.geometry import (
    Sim3,
    se3_apply,
    se3_exp,
    se3_from,
    se3_parts,
    sim3_apply,
    sim3_apply_poses,
    sim3_apply_trajectory,
    sim3_compose,
    sim3_inverse,
    so3_exp,
    so3_matrix,
)


def random_sim3(kind: str, seed: int) -> Sim3:
    tangent = jnp.asarray(random_tangents(kind, (), seed))
    scale = jnp.exp(jnp.asarray(np.random.default_rng(seed).normal() * (1e-6 if kind == "near_identity" else 0.5)))
    return Sim3(scale, so3_matrix(so3_exp(tangent[3:])), tangent[:3])


@pytest.mark.parametrize("kind", KINDS)
def test_group_laws(kind):
    a, b, c = (random_sim3(kind, seed) for seed in range(3))
    points = jnp.asarray(np.random.default_rng(0).normal(size=(2, 5, 3)))
    assert_allclose(sim3_apply(sim3_compose(a, b), points), sim3_apply(a, sim3_apply(b, points)), atol=1e-13)
    assert_allclose(sim3_apply(sim3_inverse(a), sim3_apply(a, points)), points, atol=1e-13)
    left, right = sim3_compose(sim3_compose(a, b), c), sim3_compose(a, sim3_compose(b, c))
    for x, y in zip(
        (left.scale, left.rotation, left.translation_m), (right.scale, right.rotation, right.translation_m), strict=True
    ):
        assert_allclose(x, y, atol=1e-12)
    assert_allclose(sim3_apply(sim3_compose(Sim3.identity(), a), points), sim3_apply(a, points), atol=1e-15)


def test_poses_scale_in_position_and_only_turn_in_rotation():
    """A point fixed to the body keeps its distance from the body, whatever the scale of the map."""
    sim3 = random_sim3("uniform", 3)
    pose = se3_exp(jnp.asarray(random_tangents("uniform", (4,))))
    position, quat = sim3_apply_poses(sim3, *se3_parts(pose))
    assert_allclose(position, sim3_apply(sim3, se3_parts(pose)[0]), atol=1e-13)
    lever = jnp.asarray([0.1, -0.4, 1.5])
    moved = se3_apply(se3_from(position, quat), lever) - position
    before = se3_apply(pose, lever) - se3_parts(pose)[0]
    assert_allclose(moved, np.asarray(before) @ np.asarray(sim3.rotation).T, atol=1e-13)


def test_trajectory_as_poses():
    sim3 = random_sim3("uniform", 4)
    position, quat = (np.asarray(part) for part in se3_parts(se3_exp(jnp.asarray(random_tangents("uniform", (7,))))))
    moved = sim3_apply_trajectory(sim3, Trajectory(np.arange(7.0), position, quat))
    expected_position, expected_quat = sim3_apply_poses(sim3, jnp.asarray(position), jnp.asarray(quat))
    assert_allclose(moved.position_m, expected_position, atol=1e-13)
    assert_allclose(np.abs(np.sum(moved.quat_wxyz * np.asarray(expected_quat), axis=1)), 1.0, atol=1e-14)
    assert_allclose(moved.stamp_s, np.arange(7.0))
