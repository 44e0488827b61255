import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxgeo.geometry import se3_exp, se3_parts, so3_matrix
from jaxgeo.odometry.rigid import exp_se3, inverse, log_se3, moved

tangents = st.lists(st.floats(-1.7, 1.7), min_size=6, max_size=6).map(np.array)


@given(tangents)
def test_exp_and_log_are_those_of_the_geometry(tangent):
    T = exp_se3(tangent)
    t, quat = se3_parts(se3_exp(jnp.array(tangent)))
    np.testing.assert_allclose(T[:3, 3], t, atol=1e-9)
    np.testing.assert_allclose(T[:3, :3], so3_matrix(quat), atol=1e-9)
    np.testing.assert_allclose(log_se3(T), tangent, atol=1e-7)


@given(tangents)
def test_inverse_undoes(tangent):
    T, points = exp_se3(tangent), np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.0]])
    np.testing.assert_allclose(moved(inverse(T), moved(T, points)), points, atol=1e-12)
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-12)
