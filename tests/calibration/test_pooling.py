"""Noise pooled over sessions: the likelihood got back from posteriors, and the population's mean and spread."""

import dataclasses

import numpy as np
import pytest

from calibration.models import family_prior
from calibration.pooling import (
    BETWEEN_SESSIONS,
    BETWEEN_SHARE,
    FARTHEST,
    Population,
    SessionEvidence,
    population,
    population_without,
    session_evidence,
)
from calibration.result import ModelEstimate
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS
from jaxgeo.graph.noise_defaults import default_noise

PRIOR = family_prior("lidar", default_noise("lidar"))
OWN = [0, 1, 2, 3, 4, 5, 6, 7]


def model(mean: np.ndarray, covariance: np.ndarray, own: list[int], weight: float = 1.0) -> ModelEstimate:
    sd = np.sqrt(np.diag(covariance))
    return ModelEstimate(
        name="white",
        weight=weight,
        log_evidence=0.0,
        log_predictive=0.0,
        components=tuple(COMPONENTS[i] for i in own),
        sigma=np.exp(mean),
        log_sd=sd,
        correlation=covariance / np.outer(sd, sd),
        converged=True,
    )


def random_precision(random: np.random.Generator, n: int, size: float) -> np.ndarray:
    root = random.standard_normal((n, n + 2))
    return size * root @ root.T / n


def posterior(likelihood: np.ndarray, best: np.ndarray, own: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of prior times N(best; theta, likelihood^-1)."""
    before = np.linalg.inv(PRIOR.covariance[np.ix_(own, own)])
    covariance = np.linalg.inv(before + likelihood)
    return covariance @ (before @ PRIOR.mean[own] + likelihood @ best), covariance


def drawn(n: int, mean: np.ndarray, between_sd: float, seed: int, size: float = 10.0) -> list[SessionEvidence]:
    random = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        theta = mean + between_sd * random.standard_normal(N_COMPONENTS)
        precision = random_precision(random, N_COMPONENTS, size)
        seen = theta + np.linalg.solve(np.linalg.cholesky(precision).T, random.standard_normal(N_COMPONENTS))
        found.append(SessionEvidence(precision, precision @ seen, PRIOR.mean))
    return found


def test_evidence_is_the_posterior_without_its_prior():
    random = np.random.default_rng(1)
    likelihood = random_precision(random, len(OWN), 3.0)
    best = PRIOR.mean[OWN] + 0.3 * random.standard_normal(len(OWN))
    found = session_evidence([model(*posterior(likelihood, best, OWN), OWN)], PRIOR.mean, PRIOR.covariance)
    np.testing.assert_allclose(found.precision[np.ix_(OWN, OWN)], likelihood, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found.linear[OWN], likelihood @ best, rtol=1e-8, atol=1e-8)
    rest = [i for i in range(N_COMPONENTS) if i not in OWN]
    assert not found.precision[rest].any()
    assert not found.linear[rest].any()


def test_models_count_by_their_weight_and_only_if_found():
    random = np.random.default_rng(2)
    likelihood = random_precision(random, len(OWN), 3.0)
    one = model(*posterior(likelihood, PRIOR.mean[OWN], OWN), OWN)
    lost = dataclasses.replace(one, converged=False, sigma=np.full(len(OWN), np.nan))
    half = session_evidence(
        [dataclasses.replace(one, weight=0.5), dataclasses.replace(lost, weight=0.5)], PRIOR.mean, PRIOR.covariance
    )
    np.testing.assert_allclose(half.precision[np.ix_(OWN, OWN)], 0.5 * likelihood, rtol=1e-8, atol=1e-8)


def test_a_posterior_wider_than_its_prior_says_nothing():
    wide = model(PRIOR.mean[OWN] + 1.0, 1.5 * PRIOR.covariance[np.ix_(OWN, OWN)], OWN)
    found = session_evidence([wide], PRIOR.mean, PRIOR.covariance)
    assert np.abs(found.precision).max() < 1e-9
    assert np.abs(found.linear).max() < 1e-9


def test_weak_evidence_is_not_carried_far():
    """A posterior hardly narrower than the prior, and moved: taken at its word it would lie a hundred sd away."""
    own = [7]
    sd = np.sqrt(PRIOR.covariance[7, 7])
    found = session_evidence(
        [model(PRIOR.mean[own] - sd, np.array([[0.99 * sd**2]]), own)], PRIOR.mean, PRIOR.covariance
    )
    assert found.linear[7] / found.precision[7, 7] == pytest.approx(PRIOR.mean[7] - FARTHEST * sd)


def test_sessions_that_say_nothing_leave_the_prior():
    nothing = SessionEvidence(np.zeros((N_COMPONENTS, N_COMPONENTS)), np.zeros(N_COMPONENTS), PRIOR.mean)
    found = population([nothing] * 5, PRIOR.covariance)
    np.testing.assert_allclose(found.mean, PRIOR.mean)
    np.testing.assert_allclose(found.mean_covariance, PRIOR.covariance, rtol=1e-6)
    np.testing.assert_allclose(found.between, BETWEEN_SHARE**2 * PRIOR.covariance, rtol=1e-2)


def test_many_sessions_give_mean_and_spread():
    mean = PRIOR.mean + 0.5 * np.linalg.cholesky(PRIOR.covariance) @ np.random.default_rng(3).standard_normal(
        N_COMPONENTS
    )
    found = population(drawn(200, mean, 0.3, seed=4), PRIOR.covariance)
    assert found.settled
    assert np.abs(found.mean - mean).max() < 0.12
    np.testing.assert_allclose(np.sqrt(np.diag(found.between)), 0.3, rtol=0.25)
    # Its own word on how well the mean is known: NEES of 16 numbers.
    off = found.mean - mean
    assert 5.0 < off @ np.linalg.solve(found.mean_covariance, off) < 32.0


def test_few_sessions_cannot_say_that_all_are_alike():
    same = drawn(1, PRIOR.mean, 0.0, seed=5, size=1e4) * 3
    found = population(same, PRIOR.covariance)
    least = BETWEEN_SESSIONS / (BETWEEN_SESSIONS + 3) * BETWEEN_SHARE**2 * np.diag(PRIOR.covariance)
    assert (np.diag(found.between) > 0.999 * least).all()


def objective(found: Population, sessions: list[SessionEvidence]) -> float:
    """Log posterior of mean and between, up to a constant: the sessions' thetas integrated out."""
    first = BETWEEN_SHARE**2 * PRIOR.covariance
    off = found.mean - PRIOR.mean
    total = -0.5 * off @ np.linalg.solve(PRIOR.covariance, off)
    total -= 0.5 * BETWEEN_SESSIONS * np.linalg.slogdet(found.between)[1]
    total -= 0.5 * BETWEEN_SESSIONS * np.trace(np.linalg.solve(found.between, first))
    for each in sessions:
        seen = np.linalg.solve(each.precision, each.linear)
        width = found.between + np.linalg.inv(each.precision)
        total -= 0.5 * (np.linalg.slogdet(width)[1] + (seen - found.mean) @ np.linalg.solve(width, seen - found.mean))
    return float(total)


def test_nothing_near_the_population_is_likelier():
    sessions = drawn(8, PRIOR.mean + 0.5, 0.4, seed=6)
    found = population(sessions, PRIOR.covariance)
    best, random = objective(found, sessions), np.random.default_rng(7)
    for size in (0.03, 0.3):
        for _ in range(20):
            root = np.linalg.cholesky(found.between)
            bent = np.eye(N_COMPONENTS) + size * random.standard_normal((N_COMPONENTS, N_COMPONENTS)) / 4
            other = dataclasses.replace(
                found,
                mean=found.mean + size * 0.2 * random.standard_normal(N_COMPONENTS),
                between=root @ bent @ bent.T @ root.T,
            )
            assert objective(other, sessions) < best + 1e-4


def test_the_order_of_sessions_does_not_matter():
    sessions = drawn(6, PRIOR.mean, 0.3, seed=8)
    one, other = population(sessions, PRIOR.covariance), population(sessions[::-1], PRIOR.covariance)
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-9)
    np.testing.assert_allclose(one.between, other.between, atol=1e-9)


def test_nothing_of_a_session_reaches_its_own_prior():
    sessions = drawn(5, PRIOR.mean, 0.3, seed=9)
    other = [*sessions[:1], *drawn(2, PRIOR.mean + 2.0, 0.3, seed=10), *sessions[3:]]
    found, alike = (population_without(each, [1, 2], PRIOR.covariance) for each in (sessions, other))
    assert found is not None
    assert alike is not None
    assert found.n_sessions == 3
    np.testing.assert_array_equal(found.mean, alike.mean)
    np.testing.assert_array_equal(found.between, alike.between)
    assert np.abs(found.mean - population(sessions, PRIOR.covariance).mean).max() > 1e-3
    assert population_without(sessions, range(5), PRIOR.covariance) is None


def test_a_population_needs_a_session():
    with pytest.raises(ValueError, match="no session"):
        population([], PRIOR.covariance)
