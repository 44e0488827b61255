"""Laplace evidence and corrected draws against integrals on a grid; and a model that fails must not spoil the rest."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.toy_contrasts import toy, toy_prior

from calibration.fit import STARTS, ModelFit, fit_family, model_weights
from calibration.learn import ensemble_from
from calibration.reml import Contrasts, Prior, negative_log_posterior
from jaxgeo.graph.components import N_COMPONENTS

SIX = jnp.asarray(np.array(STARTS))[None, :, None] * jnp.ones((3, 1, N_COMPONENTS))
MODELS = ((0,), (7,), (0, 7))

fit = jax.jit(lambda found, priors: fit_family(found, priors, SIX + priors.mean[:, None]))


def priors_of(models=MODELS) -> Prior:
    each = [toy_prior(free, 0.7, 1.0, 0.4 * (len(free) > 1)) for free in models]
    return jax.tree.map(lambda *x: jnp.stack(x), *each)


def one(priors: Prior, row: int) -> Prior:
    return jax.tree.map(lambda x: x[row], priors)


@jax.jit
def on_grid(points: jax.Array, found: Contrasts, prior: Prior) -> jax.Array:
    return jax.lax.map(lambda theta: -negative_log_posterior(theta, (found, prior)), points, batch_size=64)


def integrated(found: Contrasts, prior: Prior, free: tuple[int, ...]) -> tuple[float, np.ndarray, np.ndarray]:
    """Log evidence; mean and standard deviation of the free log sigmas: sums over a grid of 7 prior sigmas."""
    axis = np.linspace(-6.0, 5.0, 81)
    grid = np.stack(np.meshgrid(*[axis] * len(free), indexing="ij"), axis=-1).reshape(-1, len(free))
    points = np.zeros((len(grid), N_COMPONENTS))
    points[:, free] = grid
    log_p = np.asarray(on_grid(jnp.asarray(points), found, prior))
    p = np.exp(log_p - log_p.max())
    cell = (axis[1] - axis[0]) ** len(free)
    own = np.asarray(prior.precision)[np.ix_(free, free)]
    # The prior's own normalisation: evidence is of a density.
    norm = 0.5 * np.linalg.slogdet(own)[1] - 0.5 * len(free) * np.log(2.0 * np.pi)
    mean = p @ grid / p.sum()
    return log_p.max() + np.log(p.sum() * cell) + norm, mean, np.sqrt(p @ (grid - mean) ** 2 / p.sum())


@pytest.fixture(scope="module", params=[1, 2, 3])
def fitted(request) -> tuple[Contrasts, Prior, ModelFit]:
    found = toy(120, {0: 1.5, 7: 1.0}, request.param)
    priors = priors_of()
    return found, priors, fit(found, priors)


def test_evidence_is_the_integral(fitted):
    """Differences between models within 0.1 nat, of several; where the posterior is less normal it is further off."""
    found, priors, got = fitted
    assert bool(got.converged.all())
    expected = np.array([integrated(found, one(priors, i), free)[0] for i, free in enumerate(MODELS)])
    assert np.ptp(expected) > 0.5
    assert_allclose(got.log_evidence, expected, rtol=0, atol=0.15)
    assert_allclose(np.diff(got.log_evidence), np.diff(expected), rtol=0, atol=0.1)
    score = 0.5 * (expected + np.asarray(got.log_predictive))
    weight = np.exp(score - score.max())
    assert_allclose(model_weights(got), weight / weight.sum(), rtol=0, atol=0.05)


def test_draws_have_the_posterior_moments(fitted):
    """Sixteen draws: the mean within a quarter of a standard deviation, the standard deviation within 30 per cent."""
    found, priors, got = fitted
    for i, free in enumerate(MODELS):
        _, mean, sd = integrated(found, one(priors, i), free)
        weight = np.exp(np.asarray(got.log_weight)[i])
        assert_allclose(weight.sum(), 1.0, rtol=1e-12)
        draws = np.asarray(got.draws)[i][:, free]
        ours = weight @ draws
        assert np.abs((ours - mean) / sd).max() < 0.25
        assert_allclose(np.sqrt(weight @ (draws - ours) ** 2), sd, rtol=0.3)
        # What the model does not have is not drawn.
        frozen = np.setdiff1d(np.arange(N_COMPONENTS), free)
        assert np.array_equal(
            np.asarray(got.draws)[i][:, frozen], np.broadcast_to(np.asarray(got.theta)[i, frozen], (16, len(frozen)))
        )
        assert np.all(np.asarray(got.covariance)[i][frozen] == 0.0)


def test_without_data_the_prior_comes_back():
    """Evidence 0 of every model, mean and covariance the prior's."""
    found = toy(60, {}, 4)
    nothing = eqx.tree_at(
        lambda f: (f.c, f.components), found, (jnp.zeros_like(found.c), jnp.zeros_like(found.components))
    )
    priors = priors_of()
    got = fit(nothing, priors)
    assert_allclose(got.log_evidence, 0.0, atol=1e-9)
    assert_allclose(model_weights(got), 1.0 / 3.0, rtol=1e-9)
    for i, free in enumerate(MODELS):
        own = np.ix_(free, free)
        expected = np.linalg.inv(np.asarray(priors.precision)[i][own])
        assert_allclose(np.asarray(got.covariance)[i][own], expected, rtol=1e-9)
        assert_allclose(np.asarray(got.theta)[i, list(free)], np.log(0.7), rtol=0, atol=1e-3)
        # The normal needs no correction: all draws weigh the same.
        assert_allclose(got.log_weight[i], -np.log(16.0), rtol=0, atol=1e-3)


def test_the_ensemble_is_every_model_s_draws(fitted):
    _, priors, got = fitted
    ensemble = ensemble_from(got, priors, jnp.asarray(5.0))
    assert ensemble.sigma.shape == (3 * 16, N_COMPONENTS)
    assert_allclose(ensemble.weight.reshape(3, 16).sum(axis=1), model_weights(got), rtol=1e-9)
    sigma = np.asarray(ensemble.sigma).reshape(3, 16, N_COMPONENTS)
    for i, free in enumerate(MODELS):
        assert_allclose(sigma[i][:, free], np.exp(np.asarray(got.draws)[i][:, free]), rtol=1e-12)
        assert np.all(np.delete(sigma[i], free, axis=1) == 0.0)


def test_a_model_that_fails_has_no_weight_and_spoils_nothing(fitted):
    found, priors, got = fitted
    hopeless = eqx.tree_at(lambda p: p.mean, priors, priors.mean.at[1].set(jnp.nan))
    bad = fit(found, hopeless)
    assert list(np.asarray(bad.converged)) == [True, False, True]
    assert float(model_weights(bad)[1]) == 0.0
    ensemble = ensemble_from(bad, hopeless, jnp.asarray(5.0))
    assert np.all(np.isfinite(ensemble.sigma))
    assert np.all(np.isfinite(ensemble.weight))
    assert_allclose(ensemble.weight.sum(), 1.0, rtol=1e-12)
    assert np.all(np.asarray(ensemble.weight).reshape(3, 16)[1] == 0.0)
    assert np.array_equal(bad.theta[0], got.theta[0])
