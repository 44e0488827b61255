"""Profile likelihoods against brute force: SciPy minimises what is left, written anew in NumPy."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize
from synthetic_contrasts import contrasts_of

from calibration.fit import fit_family
from calibration.learn import Learned
from calibration.models import FamilyPrior, family_prior
from calibration.profile import DROP_95, ProfileLikelihood, open_end_sentence, profile_likelihoods
from calibration.reml import Prior
from jaxgeo.graph.components import COMPONENTS, LOG_SCALE, N_COMPONENTS, ROT, TRANS, TURN
from jaxgeo.graph.noise_defaults import default_noise

ROWS = 24
SEEN, UNSEEN, ABSENT = 0, 1, 3


@dataclasses.dataclass(frozen=True)
class Small:
    """A problem of one model, and what profiles need of it."""

    learned: Learned
    c: np.ndarray
    base: np.ndarray
    components: np.ndarray
    prior: FamilyPrior


def small(seed: int = 0) -> Small:
    """White model: `SEEN` dominates the data, `UNSEEN` has no effect at all, `ABSENT` was not in what drew them."""
    random = np.random.default_rng(seed)
    prior = family_prior("lidar", default_noise("lidar"))
    prior = dataclasses.replace(prior, free=prior.free[:1])
    components = np.zeros((N_COMPONENTS, ROWS, ROWS))
    for component in (*range(TRANS.start, TRANS.stop), *range(ROT.start, ROT.stop), TURN, LOG_SCALE):
        part = random.standard_normal((ROWS, 6))
        # One standard deviation of the prior's median moves a row by as much as the anchors' own noise, or more.
        components[component] = part @ part.T * np.exp(-2.0 * prior.mean[component])
    components[SEEN] *= 30.0
    components[UNSEEN] = 0.0
    base = np.eye(ROWS)
    drawn = base + sum(np.exp(2.0 * prior.mean[i]) * components[i] for i in (SEEN, TRANS.stop - 1, LOG_SCALE))
    c = np.linalg.cholesky(drawn) @ random.standard_normal(ROWS)
    found = contrasts_of(c, base, components, ROWS)
    own = Prior(jnp.asarray(prior.mean)[None], jnp.asarray(prior.precision), jnp.asarray(prior.free))
    fit = fit_family(found, own, jnp.asarray(prior.mean)[None, None])
    return Small(Learned(None, fit, jnp.ones(1), found, own), c, base, components, prior)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def problem() -> Small:
    return small()


@pytest.fixture(scope="module")
def profiles(problem: Small) -> dict[str, ProfileLikelihood]:
    return {p.component: p for p in profile_likelihoods(problem.learned)}


def objective(theta: np.ndarray, problem: Small, *, with_prior: bool = True) -> float:
    """Restricted negative log-likelihood, and the prior's half square, of all free log sigmas."""
    free = problem.prior.free[0] > 0
    m = problem.base + np.einsum("c,cxy->xy", np.exp(2.0 * theta), problem.components[free])
    value = 0.5 * problem.c @ np.linalg.solve(m, problem.c) + 0.5 * np.linalg.slogdet(m)[1]
    off = theta - problem.prior.mean[free]
    covariance = problem.prior.covariance[np.ix_(free, free)]
    return float(value + 0.5 * off @ np.linalg.solve(covariance, off) * with_prior)


def brute_force(problem: Small, pick: np.ndarray, at: float | None) -> np.ndarray:
    """Best theta with `pick' theta` at a value; free where it is None. What is left is an orthonormal basis."""
    free = problem.prior.free[0] > 0
    pick = pick[free]
    start = problem.prior.mean[free]
    basis = np.eye(len(start))
    if at is not None:
        start = start + pick * (at - pick @ start) / (pick @ pick)
        basis = np.linalg.svd(pick[None])[2][1:].T
    found = minimize(lambda x: objective(start + basis @ x, problem), np.zeros(basis.shape[1]), options={"gtol": 1e-6})
    return start + basis @ found.x


def pick_of(name: str) -> np.ndarray:
    pick = np.zeros(N_COMPONENTS)
    if name in COMPONENTS:
        pick[COMPONENTS.index(name)] = 1.0
    else:
        pick[TRANS if name.startswith("trans") else ROT] = 1.0 / 3.0
    return pick


@pytest.mark.parametrize("name", ["trans_x_m_per_sqrt_m", "turn_rad_per_sqrt_rad", "log_scale", "rot_rad_per_sqrt_m"])
def test_drops_are_those_of_brute_force(problem: Small, profiles: dict[str, ProfileLikelihood], name: str):
    profile, pick = profiles[name], pick_of(name)
    best = brute_force(problem, pick, None)
    path = [brute_force(problem, pick, at) for at in np.log(profile.sigma[::3])]
    drop = np.array([objective(theta, problem) for theta in path]) - objective(best, problem)
    np.testing.assert_allclose(profile.drop[::3], drop, atol=2e-6)
    alone = np.array([objective(theta, problem, with_prior=False) for theta in path])
    np.testing.assert_allclose(np.diff(profile.drop_likelihood[::3]), np.diff(alone), atol=1e-3)


def test_every_component_of_the_model_has_one_and_every_group(profiles: dict[str, ProfileLikelihood]):
    white = {*COMPONENTS[:7], "log_scale", "trans_m_per_sqrt_m", "rot_rad_per_sqrt_m"}
    assert set(profiles) == white
    for profile in profiles.values():
        assert np.all(np.diff(profile.sigma) > 0)
        assert np.min(profile.drop) == 0.0
        assert np.min(profile.drop_likelihood) == 0.0


@pytest.mark.parametrize("name", ["trans_x_m_per_sqrt_m", "log_scale", "trans_m_per_sqrt_m"])
def test_the_intervals_ends_are_where_brute_force_drops_by_that_much(
    problem: Small, profiles: dict[str, ProfileLikelihood], name: str
):
    pick = pick_of(name)
    best = objective(brute_force(problem, pick, None), problem)
    for end in profiles[name].interval_95:
        assert end is not None
        dropped = objective(brute_force(problem, pick, np.log(end)), problem) - best
        # Between two points of the grid.
        assert dropped == pytest.approx(DROP_95, rel=0.03)


def test_open_ends_are_said_in_words(profiles: dict[str, ProfileLikelihood]):
    seen, unseen, absent = (profiles[COMPONENTS[i]] for i in (SEEN, UNSEEN, ABSENT))
    assert None not in seen.likelihood_interval_95
    assert open_end_sentence(seen) is None
    low, high = absent.likelihood_interval_95
    assert low is None
    assert high is not None
    assert f"bound {absent.component} only from above: below {high:.2g}" in str(open_end_sentence(absent))
    # What has no effect is still tied to the other axes, whose level the data do bound, but only by the prior.
    assert None not in unseen.interval_95
    only_below = dataclasses.replace(seen, likelihood_interval_95=(0.25, None))
    assert "only from below: above 0.25" in str(open_end_sentence(only_below))
    neither = dataclasses.replace(seen, likelihood_interval_95=(None, None))
    assert "do not bound" in str(open_end_sentence(neither))


def test_a_grid_too_narrow_is_widened(problem: Small, profiles: dict[str, ProfileLikelihood]):
    """Laplace's width far too small: the ends are found all the same."""
    learned = eqx.tree_at(lambda x: x.fit.covariance, problem.learned, 1e-4 * problem.learned.fit.covariance)
    again = {p.component: p for p in profile_likelihoods(learned)}
    name = "turn_rad_per_sqrt_rad"
    assert np.log(again[name].sigma[-1] / again[name].sigma[0]) > 3.5
    np.testing.assert_allclose(again[name].interval_95, profiles[name].interval_95, rtol=0.05)  # type: ignore[arg-type]


def test_a_model_without_an_optimum_has_no_interval(problem: Small):
    learned = eqx.tree_at(lambda x: x.found.c, problem.learned, problem.learned.found.c * jnp.nan)
    profile = profile_likelihoods(learned, 0)[0]
    assert np.isnan(profile.drop).all()
    assert profile.interval_95 == (None, None)


def test_the_most_probable_model_is_taken(problem: Small):
    """Two models, the second without the turns: its weight decides."""
    free = np.repeat(problem.prior.free, 2, axis=0)
    free[1, TURN] = 0.0
    prior = dataclasses.replace(problem.prior, free=free)
    mean = jnp.broadcast_to(jnp.asarray(prior.mean), free.shape)
    own = Prior(mean, jnp.asarray(prior.precision), jnp.asarray(free))
    fit = fit_family(problem.learned.found, own, mean[:, None])
    first, second = (
        {p.component for p in profile_likelihoods(Learned(None, fit, weight, problem.learned.found, own))}  # type: ignore[arg-type]
        for weight in jnp.array([[0.9, 0.1], [0.1, 0.9]])
    )
    assert first - second == {"turn_rad_per_sqrt_rad"}
    assert second < first
