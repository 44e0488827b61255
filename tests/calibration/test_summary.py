"""What is read from the models' posteriors: mixture quantiles, and moments of components that a model lacks."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm
from solve.revisited_session import KIND, MEDIANS, revisited_session

from calibration.learn import LEARNING_ROUNDS
from calibration.models import MODELS, FamilyPrior, family_prior
from calibration.result import Calibration
from calibration.summary import summarise
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS, NoiseEnsemble

SPAN_M = 80.0
WEIGHT = np.array([0.3, 0.25, 0.2, 0.15, 0.07, 0.03])
ANCHORS = revisited_session().anchors


def learned_of(prior: FamilyPrior, theta, covariance, weight=WEIGHT, converged=None) -> SimpleNamespace:
    """The arrays of `Learned` that a summary reads."""
    models = len(MODELS)
    mean = np.broadcast_to(prior.mean + prior.per_log_span * np.log(SPAN_M), (models, N_COMPONENTS))
    ensemble = NoiseEnsemble(np.ones((2, N_COMPONENTS)), np.array([0.5, 0.5]), np.array(8.0))
    fit = SimpleNamespace(
        theta=theta,
        covariance=covariance,
        log_evidence=np.log(np.maximum(weight, 1e-9)) - 40.0,
        log_predictive=0.5 * np.log(np.maximum(weight, 1e-9)) - 30.0,
        draws=theta[:, None],
        log_weight=np.zeros((models, 1)),
        converged=np.ones(models, dtype=bool) if converged is None else converged,
    )
    return SimpleNamespace(
        fold=SimpleNamespace(ensemble=ensemble, rounds=np.array(4), settled=np.array(True)),
        fit=fit,
        model_weight=weight,
        found=SimpleNamespace(count=np.array(15.0)),
        prior=SimpleNamespace(mean=mean, precision=prior.precision, free=prior.free),
    )


@pytest.fixture(scope="module")
def prior() -> FamilyPrior:
    return family_prior(KIND, MEDIANS)


@pytest.fixture(scope="module")
def posterior(prior) -> tuple[np.ndarray, np.ndarray]:
    """Any normals on each model's own components."""
    rng = np.random.default_rng(11)
    free = prior.free
    theta = np.where(free > 0, rng.normal(-3.0, 1.5, free.shape), 99.0)
    root = rng.normal(0.0, 0.15, (*free.shape, N_COMPONENTS)) + 0.4 * np.eye(N_COMPONENTS)
    return theta, (root @ np.swapaxes(root, 1, 2)) * free[:, :, None] * free[:, None]


@pytest.fixture(scope="module")
def summary(prior, posterior) -> Calibration:
    return summarise(learned_of(prior, *posterior), prior, KIND, "both", ANCHORS)


def picks() -> dict[str, np.ndarray]:
    found = dict(zip(COMPONENTS, np.eye(N_COMPONENTS), strict=True))
    third = np.zeros((2, N_COMPONENTS))
    third[0, 0:3] = third[1, 3:6] = 1.0 / 3.0
    return found | {"trans_m_per_sqrt_m": third[0], "rot_rad_per_sqrt_m": third[1]}


def test_quantiles_are_the_mixture_s(prior, posterior, summary):
    theta, covariance = posterior
    assert {s.component for s in summary.sigmas} == set(picks()) - {"anchor_factor"}
    for s in summary.sigmas:
        pick = picks()[s.component]
        has = np.all(prior.free[:, pick > 0] > 0, axis=1)
        share = WEIGHT[has] / WEIGHT[has].sum()
        assert_allclose(s.probability, WEIGHT[has].sum())
        centre, sd = theta[has] @ pick, np.sqrt(np.einsum("a,mab,b->m", pick, covariance[has], pick))
        for q, value in ((0.5, s.median), (0.16, s.low_68), (0.84, s.high_68), (0.025, s.low_95), (0.975, s.high_95)):
            assert_allclose(share @ norm.cdf((np.log(value) - centre) / sd), q, rtol=0, atol=1e-9, err_msg=s.component)
        second = share @ (centre**2 + sd**2)
        assert_allclose(s.log_sd, np.sqrt(second - (share @ centre) ** 2), rtol=1e-9)
        mean = prior.mean + prior.per_log_span * np.log(SPAN_M)
        assert_allclose(s.prior_median, np.exp(pick @ mean))
        assert_allclose(s.prior_log_sd, np.sqrt(pick @ prior.covariance @ pick))


def test_components_that_a_model_lacks_follow_the_prior(prior, posterior, summary):
    """In information form: the prior's joint normal, in which the model's own components have their posterior."""
    theta, covariance = posterior
    mean = prior.mean + prior.per_log_span * np.log(SPAN_M)
    prior_precision = np.linalg.inv(prior.covariance)
    means, covariances = [], []
    for m, free in enumerate(prior.free > 0):
        own = np.ix_(free, free)
        precision, pull = prior_precision.copy(), prior_precision @ mean
        said, before = np.linalg.inv(covariance[m][own]), np.linalg.inv(prior.covariance[own])
        precision[own] += said - before
        pull[free] += said @ theta[m, free] - before @ mean[free]
        covariances.append(np.linalg.inv(precision))
        means.append(covariances[-1] @ pull)
    middle = WEIGHT @ np.array(means)
    off = np.array(means) - middle
    spread = np.array(covariances) + off[:, :, None] * off[:, None]
    assert_allclose(summary.theta_mean, middle, rtol=0, atol=1e-7)
    assert_allclose(summary.theta_covariance, np.einsum("m,mab->ab", WEIGHT, spread), rtol=0, atol=1e-7)


def test_models_best_first(prior, posterior, summary):
    theta, covariance = posterior
    assert [m.name for m in summary.models] == list(MODELS)
    assert_allclose([m.weight for m in summary.models], WEIGHT)
    assert_allclose([m.log_evidence for m in summary.models], np.log(WEIGHT / WEIGHT[0]))
    assert_allclose([m.log_predictive for m in summary.models], 0.5 * np.log(WEIGHT / WEIGHT[0]))
    for m, (estimate, free) in enumerate(zip(summary.models, prior.free > 0, strict=True)):
        assert estimate.components == tuple(np.array(COMPONENTS)[free])
        assert_allclose(estimate.sigma, np.exp(theta[m, free]))
        own = covariance[m][np.ix_(free, free)]
        assert_allclose(estimate.log_sd, np.sqrt(np.diag(own)))
        assert_allclose(estimate.correlation * np.outer(estimate.log_sd, estimate.log_sd), own, rtol=1e-10, atol=1e-14)
    other = summarise(learned_of(prior, *posterior, weight=WEIGHT[::-1]), prior, KIND, "both", ANCHORS)
    assert [m.name for m in other.models] == list(MODELS)[::-1]


def test_counts(summary):
    assert (summary.n_contrasts, summary.n_revisits, summary.rounds, summary.settled) == (15, 1, 4, True)


def test_a_model_that_was_not_found_spoils_nothing(prior, posterior):
    theta, covariance = posterior
    weight = WEIGHT.copy()
    weight[2] = 0.0
    weight /= weight.sum()
    converged = np.arange(len(MODELS)) != 2
    broken = np.where(converged[:, None, None], covariance, np.nan)
    learned = learned_of(prior, theta, broken, weight, converged)
    found = summarise(learned, prior, KIND, "both", ANCHORS)
    assert np.all(np.isfinite(found.theta_mean))
    assert np.all(np.isfinite(found.theta_covariance))
    assert all(np.isfinite(s.median) and np.isfinite(s.log_sd) for s in found.sigmas)
    expected = summarise(learned_of(prior, theta, covariance, weight), prior, KIND, "both", ANCHORS)
    assert_allclose(found.theta_mean, expected.theta_mean, rtol=0, atol=1e-12)
    (x, _), (y, _) = ([s for s in each.sigmas if s.component in COMPONENTS[:2]] for each in (found, expected))
    assert_allclose(x.median, y.median, rtol=1e-9)


def test_a_noise_that_was_held_is_said(prior, posterior):
    learned = learned_of(prior, *posterior)
    before = summarise(learned, prior, KIND, "both", ANCHORS).sentences
    learned.fold.rounds = np.array(LEARNING_ROUNDS + 1)
    said = summarise(learned, prior, KIND, "both", ANCHORS).sentences
    assert said[1:] == before
    assert said[0].startswith(f"Noise and trajectory did not settle together in {LEARNING_ROUNDS} rounds")
