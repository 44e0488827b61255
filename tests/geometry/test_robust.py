import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from jaxgeo.errors import ConfigError
from jaxgeo.geometry import check_robust, robust_residual, robust_rho, robust_weight

KINDS = ("none", "huber", "cauchy", "geman_mcclure")
SQUARED = np.array([0.0, 1e-300, 1e-12, 1e-3, 0.0089, 0.0091, 1.0, 8.9, 9.1, 100.0, 1e8])


@pytest.mark.parametrize(("ours", "theirs"), [("huber", "huber"), ("cauchy", "cauchy"), ("none", "linear")])
def test_rho_is_that_of_scipy(ours, theirs):
    """SciPy's cost is 1/2 C^2 rho((f / C)^2); with a constant residual it stops where it starts."""

    def constant(x, residual):
        return 0.0 * x + residual

    for s in SQUARED[2:]:
        solution = least_squares(constant, [0.0], loss=theirs, f_scale=3.0, args=(np.sqrt(s),))
        assert_allclose(robust_rho(jnp.asarray(s), ours, 3.0), 2.0 * solution.cost, rtol=1e-12)


def test_geman_mcclure_by_its_formula():
    assert_allclose(robust_rho(jnp.asarray(SQUARED), "geman_mcclure", 3.0), 9.0 * SQUARED / (9.0 + SQUARED), rtol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_weight_is_the_derivative_of_rho(kind):
    s = jnp.asarray(SQUARED)
    derivative = jax.vmap(jax.grad(lambda x: robust_rho(x, kind, 3.0)))(s)
    assert_allclose(robust_weight(s, kind, 3.0), derivative, rtol=1e-8)
    assert robust_weight(s, kind, 3.0)[0] == 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_small_residuals_count_in_full(kind):
    assert_allclose(robust_rho(jnp.asarray(1e-8), kind, 2.0), 1e-8, rtol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_residual_carries_rho_and_is_smooth_at_zero(kind):
    r = jnp.asarray(np.random.default_rng(0).normal(size=(20, 3)) * np.logspace(-6, 3, 20)[:, None])
    shortened = robust_residual(r, kind, 2.0)
    assert_allclose(jnp.sum(shortened**2, axis=-1), robust_rho(jnp.sum(r**2, axis=-1), kind, 2.0), rtol=1e-12)
    for jacobian in (jax.jacfwd, jax.jacrev):
        assert_allclose(jacobian(lambda x: robust_residual(x, kind, 2.0))(jnp.zeros(3)), np.eye(3))


def test_unknown_loss_and_width():
    with pytest.raises(ConfigError, match="'tukey' is unknown; expected one of none, huber, cauchy, geman_mcclure"):
        check_robust("tukey", 1.0)
    for width in (0.0, -1.0, float("nan")):
        with pytest.raises(ConfigError, match="not positive"):
            check_robust("huber", width)
