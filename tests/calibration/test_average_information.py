"""The damped average-information minimiser against SciPy's, from several starts, and beside a lane that fails."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from solve.toy_contrasts import toy, toy_prior

from calibration.average_information import AverageInformation
from calibration.fit import MAX_STEPS
from calibration.reml import derivatives, hessian, negative_log_posterior
from jaxgeo.graph.components import N_COMPONENTS

FREE = (0, 3, 7, 14)
TRUE = {0: 2.0, 3: 0.7, 7: 5.0, 14: 0.01}
SOLVER = AverageInformation()


@jax.jit
@jax.vmap
def minimum(found, prior, start) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    got = optx.minimise(negative_log_posterior, SOLVER, start, (found, prior), max_steps=MAX_STEPS, throw=False)
    return got.value, got.state.at.value, got.result == optx.RESULTS.successful, got.stats["num_steps"]


def stacked(*each):
    return jax.tree.map(lambda *x: jnp.stack(x), *each)


STARTS = np.array([0.0, 3.0, -3.0, 1.0])[:, None] * np.ones(N_COMPONENTS)


@pytest.fixture(scope="module")
def problem():
    return toy(40, TRUE, 5), toy_prior(FREE, 0.5, 1.5, 0.3)


def test_same_optimum_as_scipy(problem):
    found, prior = problem
    theta, value, converged, steps = minimum(stacked(*[found] * 4), stacked(*[prior] * 4), jnp.asarray(STARTS))
    assert bool(converged.all())
    assert int(steps.max()) < 40
    free = np.array(FREE)

    def full(x: np.ndarray) -> jax.Array:
        return jnp.zeros(N_COMPONENTS).at[free].set(jnp.asarray(x))

    at = jax.jit(derivatives)
    peer = minimize(
        lambda x: float(at(full(x), problem).value),
        np.zeros(4),
        jac=lambda x: np.asarray(at(full(x), problem).gradient)[free],
        method="BFGS",
        options={"gtol": 1e-10},
    )
    sd = np.sqrt(np.diagonal(np.linalg.inv(np.asarray(jax.jit(hessian)(full(peer.x), problem)))))[free]
    # The tolerance, 1e-7 nat, is 5e-4 standard deviations.
    assert np.abs((np.asarray(theta)[:, free] - peer.x) / sd).max() < 2e-3
    assert_allclose(value, peer.fun, rtol=0, atol=1e-6)
    assert np.abs(peer.x).min() > 0.05


def test_frozen_components_stay_where_they_started(problem):
    found, prior = problem
    theta, *_ = minimum(stacked(*[found] * 4), stacked(*[prior] * 4), jnp.asarray(STARTS))
    frozen = np.setdiff1d(np.arange(N_COMPONENTS), FREE)
    assert np.array_equal(theta[:, frozen], STARTS[:, frozen])


def test_a_lane_that_fails_says_so_and_harms_no_other(problem):
    found, prior = problem
    broken = eqx.tree_at(lambda f: f.base, found, found.base.at[0, 0].set(-1e6))
    args = stacked(found, broken, found, found), stacked(*[prior] * 4)
    theta, value, converged, _ = minimum(*args, jnp.asarray(STARTS))
    assert list(np.asarray(converged)) == [True, False, True, True]
    assert np.isnan(value[1])
    alone = minimum(stacked(*[found] * 4), stacked(*[prior] * 4), jnp.asarray(STARTS))
    for row in (0, 2, 3):
        assert np.array_equal(theta[row], alone[0][row])
        assert float(value[row]) == float(alone[1][row])
