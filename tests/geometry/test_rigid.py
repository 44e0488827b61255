"""4x4 motions against the estimators' own SE(3)."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxgeo.geometry import rigid, se3_exp, se3_log, se3_parts


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 0.3, 2.5])
def test_exp_and_log_agree_with_geometry(size):
    rng = np.random.default_rng(1)
    tangent = rng.normal(size=(20, 6))
    tangent[:, 3:] *= size / np.linalg.norm(tangent[:, 3:], axis=1, keepdims=True)
    T = rigid.exp(tangent)
    t, quat = (np.asarray(part) for part in se3_parts(se3_exp(jnp.asarray(tangent))))
    assert np.allclose(T, rigid.matrices(t, quat), atol=1e-12)
    assert np.allclose(rigid.log(T), np.asarray(se3_log(se3_exp(jnp.asarray(tangent)))), atol=1e-9)
    assert np.allclose(rigid.log(T), tangent, atol=1e-9)


def test_adjoint_moves_a_tangent_across():
    rng = np.random.default_rng(2)
    T, x = rigid.exp(rng.normal(size=(7, 6))), rng.normal(size=(7, 6))
    moved = np.einsum("nab,nb->na", rigid.adjoint(T), x)
    assert np.allclose(T @ rigid.exp(x) @ rigid.inverse(T), rigid.exp(moved), atol=1e-12)


def test_parts_and_matrices_are_inverses():
    T = rigid.exp(np.random.default_rng(3).normal(size=(9, 6)))
    assert np.allclose(rigid.matrices(*rigid.parts(T)), T, atol=1e-14)
    assert np.allclose(T @ rigid.inverse(T), np.eye(4), atol=1e-14)
