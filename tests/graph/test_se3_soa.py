import jax
import jax.numpy as jnp
import numpy as np
import pytest
from geometry.random_poses import KINDS, random_tangents
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from jaxgeo.geometry import hat, se3_compose, se3_exp, se3_inverse, se3_log
from jaxgeo.graph import se3_soa, soa

N = 64
AXIS = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
# Zero, around the logarithm's change of series (0.25 rad), and up to half a turn.
ANGLES = np.array([0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.2499, 0.2501, 1.0, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-7])

exp, log = jax.jit(se3_soa.exp), jax.jit(se3_soa.log)
right_jacobian = jax.jit(se3_soa.right_jacobian)
inverse_right_jacobian_transposed = jax.jit(se3_soa.inverse_right_jacobian_transposed)
exp_of_geometry, log_of_geometry = jax.jit(se3_exp), jax.jit(se3_log)
difference_of_geometry = jax.jit(lambda back, tangent: se3_log(se3_compose(back, se3_exp(tangent))))


def parts(tangent: np.ndarray):
    """(m, 6) as two component tuples, (translation, rotation)."""
    columns = tuple(jnp.asarray(c) for c in np.asarray(tangent).T)
    return columns[:3], columns[3:]


def rows(components) -> np.ndarray:
    return np.stack([np.asarray(c) for c in components], axis=-1)


def algebra(tangent: np.ndarray) -> np.ndarray:
    result = np.zeros((4, 4))
    result[:3, :3] = np.asarray(hat(jnp.asarray(tangent[3:])))
    result[:3, 3] = tangent[:3]
    return result


def by_angle() -> np.ndarray:
    return np.concatenate([np.tile([1.0, -2.0, 3.0], (N, 1)), np.resize(ANGLES, N)[:, None] * AXIS], axis=1)


def inputs(kind: str) -> np.ndarray:
    return by_angle() if kind == "by_angle" else random_tangents(kind, (N,))


@pytest.mark.parametrize("kind", [*KINDS, "by_angle"])
class TestAgainstOthers:
    def test_exp_is_the_matrix_exponential(self, kind):
        tangent = inputs(kind)
        quat, t = exp(*parts(tangent))
        expected = np.stack([expm(algebra(x)) for x in tangent])
        assert_allclose(Rotation.from_quat(rows(quat), scalar_first=True).as_matrix(), expected[:, :3, :3], atol=5e-14)
        assert_allclose(np.linalg.norm(rows(quat), axis=1), 1.0, atol=1e-14)
        assert_allclose(rows(t), expected[:, :3, 3], rtol=0, atol=1e-13)

    def test_exp_and_log_are_those_of_geometry(self, kind):
        tangent = inputs(kind)
        pose = exp_of_geometry(jnp.asarray(tangent))
        quat, t = exp(*parts(tangent))
        assert_allclose(np.concatenate([rows(quat), rows(t)], axis=1), pose.wxyz_xyz, atol=1e-13)
        logarithm = np.concatenate([rows(p) for p in log(quat, t)], axis=1)
        assert_allclose(logarithm, log_of_geometry(pose), rtol=0, atol=2e-12)
        assert_allclose(logarithm, tangent, rtol=0, atol=2e-12)

    def test_log_does_not_mind_the_sign_of_the_quaternion(self, kind):
        quat, t = exp(*parts(inputs(kind)))
        other = log(tuple(-c for c in quat), t)
        for a, b in zip(log(quat, t), other, strict=True):
            assert_allclose(rows(a), rows(b), atol=1e-14)

    def test_right_jacobian(self, kind):
        """`Exp(x)^-1 Exp(x + J_r^-1 d) = Exp(d)`: columns by differences of the exponential."""
        tangent = inputs(kind)
        jac, coupling = right_jacobian(*parts(tangent))
        found = np.zeros((len(tangent), 6, 6))
        found[:, :3, :3] = found[:, 3:, 3:] = np.stack([rows(r) for r in jac], axis=1)
        found[:, :3, 3:] = np.stack([rows(r) for r in coupling], axis=1)
        step = 1e-6
        back = se3_inverse(exp_of_geometry(jnp.asarray(tangent)))
        for i, column in enumerate(np.eye(6) * step):
            difference = [
                np.asarray(difference_of_geometry(back, jnp.asarray(tangent + s * column))) for s in (1.0, -1.0)
            ]
            assert_allclose(found[:, :, i], (difference[0] - difference[1]) / (2 * step), atol=2e-8)

    def test_inverse_right_jacobian_transposed(self, kind):
        tangent, force = inputs(kind), random_tangents("tangent_normal", (N,), seed=3)
        jac, coupling = right_jacobian(*parts(tangent))
        full = np.zeros((len(tangent), 6, 6))
        full[:, :3, :3] = full[:, 3:, 3:] = np.stack([rows(r) for r in jac], axis=1)
        full[:, :3, 3:] = np.stack([rows(r) for r in coupling], axis=1)
        found = np.concatenate(
            [rows(p) for p in inverse_right_jacobian_transposed(*parts(tangent), *parts(force))], axis=1
        )
        back = np.einsum("nji,nj->ni", full, found)
        assert_allclose(back, force, rtol=0, atol=1e-10)


def test_exp_up_to_a_whole_turn():
    tangent = np.concatenate([np.full((3, 3), 2.0), np.array([[4.0], [5.5], [6.2]]) * AXIS], axis=1)
    quat, t = exp(*parts(tangent))
    expected = np.stack([expm(algebra(x)) for x in tangent])
    assert_allclose(Rotation.from_quat(rows(quat), scalar_first=True).as_matrix(), expected[:, :3, :3], atol=1e-12)
    assert_allclose(rows(t), expected[:, :3, 3], atol=1e-11)


def test_log_of_exactly_half_a_turn():
    quat = tuple(jnp.asarray([c]) for c in (0.0, *AXIS))
    _, rotation = log(quat, tuple(jnp.zeros(1) for _ in range(3)))
    assert_allclose(rows(rotation)[0], np.pi * AXIS, atol=1e-13)


def _round_trip(tangent: jax.Array) -> jax.Array:
    columns = tuple(tangent[i : i + 1] for i in range(6))
    found = log(*exp(columns[:3], columns[3:]))
    return jnp.concatenate([c for part in found for c in part])


@jax.jit
def _derivatives(tangent: jax.Array) -> tuple[jax.Array, jax.Array]:
    """First by reverse mode, second by forward mode over it."""

    def first(x: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = jax.jacrev(_round_trip)(x)
        return found, found

    second, found = jax.jacfwd(first, has_aux=True)(tangent)
    return found, second


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.25, 2.5])
def test_derivatives_at_and_near_identity(angle):
    tangent = jnp.asarray(np.concatenate([[1.0, -2.0, 3.0], angle * AXIS]))
    first, second = _derivatives(tangent)
    assert_allclose(first, np.eye(6), rtol=0, atol=1e-12)
    assert_allclose(second, np.zeros((6, 6, 6)), rtol=0, atol=1e-10)


def test_quaternions_and_matrices():
    rng = np.random.default_rng(0)
    a, b = Rotation.random(N, rng=rng), Rotation.random(N, rng=rng)
    v = rng.normal(size=(N, 3))
    p, q = (tuple(jnp.asarray(c) for c in r.as_quat(scalar_first=True).T) for r in (a, b))
    x = tuple(jnp.asarray(c) for c in v.T)
    product = Rotation.from_quat(rows(soa.quat_mul(p, soa.quat_conj(q))), scalar_first=True)
    assert_allclose(product.as_matrix(), (a * b.inv()).as_matrix(), atol=1e-14)
    assert_allclose(rows(soa.rotate(p, x)), a.apply(v), atol=1e-14)
    m, n = soa.quat_matrix(p), soa.quat_matrix(q)
    as_array = [np.stack([rows(r) for r in matrix], axis=1) for matrix in (m, n)]
    assert_allclose(as_array[0], a.as_matrix(), atol=1e-14)
    assert_allclose(np.stack([rows(r) for r in soa.matmul(m, n)], axis=1), as_array[0] @ as_array[1], atol=1e-14)
    hatted = np.stack([rows(r) for r in soa.hat_matmul(x, m)], axis=1)
    assert_allclose(hatted, np.asarray(hat(jnp.asarray(v))) @ as_array[0], atol=1e-14)
    assert_allclose(np.stack([rows(r) for r in soa.scale_columns(m, x)], axis=1), as_array[0] * v[:, None], atol=1e-14)
