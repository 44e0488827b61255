import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest
from numpy.testing import assert_allclose
from random_poses import BATCHES, KINDS, random_tangents
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from jaxgeo.geometry import (
    hat,
    se3_adjoint,
    se3_apply,
    se3_compose,
    se3_exp,
    se3_from,
    se3_inverse,
    se3_log,
    se3_parts,
    se3_relative,
    so3_exp,
    so3_from_matrix,
    so3_left_jacobian,
    so3_left_jacobian_inverse,
    so3_log,
    so3_matrix,
    so3_multiply,
)

AXIS = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
# Around the switch from series to closed form (0.1 rad), zero, and half a turn.
ANGLES = [0.0, 1e-12, 1e-8, 9e-6, 1.1e-5, 1e-3, 0.0999, 0.1001, 1.0, 3.0, np.pi - 1e-6, np.pi - 1e-11]


def matrix(pose) -> np.ndarray:
    """(..., 4, 4) from the position and quaternion, by SciPy."""
    position, quat = (np.asarray(part) for part in se3_parts(pose))
    result = np.broadcast_to(np.eye(4), (*position.shape[:-1], 4, 4)).copy()
    turn = Rotation.from_quat(quat.reshape(-1, 4), scalar_first=True).as_matrix()
    result[..., :3, :3] = turn.reshape(*position.shape[:-1], 3, 3)
    result[..., :3, 3] = position
    return result


def algebra(tangent: np.ndarray) -> np.ndarray:
    result = np.zeros((4, 4))
    result[:3, :3] = np.asarray(hat(jnp.asarray(tangent[3:])))
    result[:3, 3] = tangent[:3]
    return result


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("kind", KINDS)
class TestGroup:
    def test_exp_log(self, kind, batch):
        tangent = jnp.asarray(random_tangents(kind, batch))
        assert_allclose(se3_log(se3_exp(tangent)), tangent, rtol=0, atol=1e-12)

    def test_compose_inverse_relative(self, kind, batch):
        a = se3_exp(jnp.asarray(random_tangents(kind, batch, seed=1)))
        b = se3_exp(jnp.asarray(random_tangents(kind, batch, seed=2)))
        assert_allclose(matrix(se3_compose(a, b)), matrix(a) @ matrix(b), atol=1e-12)
        assert_allclose(matrix(se3_inverse(a)), np.linalg.inv(matrix(a)), atol=1e-12)
        assert_allclose(matrix(se3_relative(a, b)), np.linalg.inv(matrix(a)) @ matrix(b), atol=1e-12)

    def test_apply(self, kind, batch):
        pose = se3_exp(jnp.asarray(random_tangents(kind, batch)))
        point = np.random.default_rng(0).normal(size=(*batch, 3))
        expected = np.einsum("...ij,...j->...i", matrix(pose)[..., :3, :3], point) + matrix(pose)[..., :3, 3]
        assert_allclose(se3_apply(pose, jnp.asarray(point)), expected, atol=1e-13)

    def test_adjoint_moves_a_tangent_through(self, kind, batch):
        pose = se3_exp(jnp.asarray(random_tangents(kind, batch, seed=1)))
        tangent = 0.1 * jnp.asarray(random_tangents("tangent_normal", batch, seed=2))
        moved = se3_log(se3_compose(se3_compose(pose, se3_exp(tangent)), se3_inverse(pose)))
        assert_allclose(jnp.einsum("...ij,...j->...i", se3_adjoint(pose), tangent), moved, atol=1e-12)

    def test_quaternion_and_matrix(self, kind, batch):
        rotvec = random_tangents(kind, batch)[..., 3:]
        quat = so3_exp(jnp.asarray(rotvec))
        turn = Rotation.from_rotvec(rotvec.reshape(-1, 3))
        assert_allclose(so3_matrix(quat), turn.as_matrix().reshape(*batch, 3, 3), atol=1e-14)
        again = so3_from_matrix(so3_matrix(quat))
        assert_allclose(np.abs(np.sum(np.asarray(again * quat), axis=-1)), np.ones(batch), atol=1e-14)
        assert_allclose(so3_log(so3_multiply(quat, quat)), so3_log(-so3_multiply(quat, quat)), atol=1e-14)


def test_tangents_are_those_of_jaxlie():
    tangent = jnp.asarray(random_tangents("tangent_normal", (5,)))
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        theirs = jaxlie.SE3.exp(tangent)
        assert_allclose(se3_exp(tangent).wxyz_xyz, theirs.wxyz_xyz, atol=1e-12)
        assert_allclose(se3_log(theirs), theirs.log(), atol=1e-12)


def test_hat_is_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 4, 3))
    assert_allclose(np.einsum("nij,nj->ni", hat(jnp.asarray(a)), b), np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_the_matrix_exponential(angle):
    """jaxlie 1.5 fails this below 1e-5 rad, by half of rotation times translation."""
    tangent = np.concatenate([[1.0, 2.0, 3.0], AXIS * angle])
    assert_allclose(matrix(se3_exp(jnp.asarray(tangent))), expm(algebra(tangent)), rtol=0, atol=2e-14)


def _round_trip(tangent):
    return se3_log(se3_exp(tangent))


_forward = jax.jit(jax.jacfwd(_round_trip))
_reverse = jax.jit(jax.jacrev(_round_trip))
_second_of_exp = jax.jit(jax.jacfwd(jax.jacrev(lambda tangent: se3_exp(tangent).wxyz_xyz)))
_second_of_log = jax.jit(jax.jacfwd(jax.jacrev(so3_log)))


@pytest.mark.parametrize("angle", ANGLES)
def test_log_of_exp_has_unit_derivative(angle):
    tangent = jnp.asarray(np.concatenate([[1.0, -2.0, 3.0], AXIS * angle]))
    assert_allclose(_forward(tangent), np.eye(6), rtol=0, atol=1e-10)
    assert_allclose(_reverse(tangent), np.eye(6), rtol=0, atol=1e-10)
    # Second derivatives are finite too: the implicit adjoint takes them.
    assert np.isfinite(_second_of_exp(tangent)).all()
    assert np.isfinite(_second_of_log(so3_exp(tangent[3:]))).all()


@pytest.mark.parametrize("angle", [0.0, 1e-7, 0.5, np.pi - 1e-9])
def test_derivative_of_exp_against_differences(angle):
    tangent = np.concatenate([[1.0, 2.0, 3.0], AXIS * angle])
    found = jax.jacfwd(lambda x: se3_parts(se3_exp(x))[0])(jnp.asarray(tangent))
    step = 1e-5
    for i, column in enumerate(np.eye(6) * step):
        difference = (expm(algebra(tangent + column)) - expm(algebra(tangent - column)))[:3, 3] / (2.0 * step)
        assert_allclose(found[:, i], difference, atol=1e-8)


def test_log_at_exactly_half_a_turn():
    quat = jnp.asarray([0.0, *AXIS])
    assert_allclose(so3_log(quat), AXIS * np.pi, atol=1e-15)
    # d angle / d w = -2 at w = 0: the derivative that jaxlie drops.
    assert_allclose(jax.jacfwd(so3_log)(quat)[:, 0], -2.0 * AXIS, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_left_jacobian_and_its_inverse(angle):
    rotvec = jnp.asarray(AXIS * angle)
    assert_allclose(so3_left_jacobian(rotvec) @ so3_left_jacobian_inverse(rotvec), np.eye(3), atol=1e-13)


def test_one_pose_is_broadcast_over_many():
    pose = se3_exp(jnp.asarray(random_tangents("uniform", ())))
    points = jnp.asarray(np.random.default_rng(0).normal(size=(5, 3)))
    assert_allclose(se3_apply(pose, points), np.stack([se3_apply(pose, p) for p in points]), atol=1e-14)


def test_parts_come_back():
    position, quat = jnp.arange(6.0).reshape(2, 3), jnp.eye(4)[:2]
    back = se3_parts(se3_from(position, quat))
    assert_allclose(back[0], position)
    assert_allclose(back[1], quat)
