"""Simple ways to the noise: closed forms against SciPy and against solving, and not a bit of a held-out location."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar
from synthetic_contrasts import contrasts_of

from calibration.baselines import Given, PointFold, estimated_folds
from calibration.bilevel import PRIOR_COVARIANCE, bilevel_noise, held_out_loss, outer_loss
from calibration.calibrate import LearnSettings, learn_options
from calibration.observations import learnable
from calibration.reml import Contrasts, contrasts
from calibration.scale_factor import scale_factor, scale_factor_noise
from calibration.transfer import transferred_folds, true_noise_folds
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import AnchorTable, anchor_table
from jaxgeo.graph.chain import Chain, chain_of
from jaxgeo.graph.components import LOG_SCALE, N_COMPONENTS, ROT, TRANS, NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.simulate import UAV, simulate_session
from jaxgeo.simulate.layout import ORDER, ORIGIN_ENH_M
from jaxgeo.solve.anchor_system import anchor_system, chain_linearised
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_fold import observe, start_of

NOISE = default_noise("lidar")
SETTINGS = Settings()
OPTIONS = learn_options(SETTINGS, LearnSettings("lidar", NOISE))
WIDTH = jnp.asarray(3.0)


@pytest.fixture(scope="module")
def session() -> tuple[Trajectory, Anchors]:
    simulated = simulate_session(3, dataclasses.replace(UAV, n_poses=200))
    visits, _ = label_visits(cut_visits(simulated.sightings, 5.0), simulated.survey, order=list(ORDER))
    trajectory = simulated.trajectories["icp"]
    anchors, _ = make_anchors(trajectory, simulated.sightings, visits, simulated.survey, origin_enh_m=ORIGIN_ENH_M)
    return trajectory, anchors


def arrays(session: tuple[Trajectory, Anchors], anchors: Anchors | None = None) -> tuple[Chain, AnchorTable]:
    chain = chain_of(session[0])
    return chain, anchor_table(session[1] if anchors is None else anchors, chain)


def rows(anchors: Anchors, table: AnchorTable, *without: int) -> jax.Array:
    """A row for each location left out; -1 leaves none out."""
    use = np.zeros((len(without), table.real.shape[0]))
    use[:, : len(anchors)] = anchors.location_index[None] != np.array(without)[:, None]
    return jnp.asarray(use)


@functools.partial(jax.jit, static_argnames="options")
def given_at_start(chain: Chain, table: AnchorTable, use: jax.Array, options: object) -> Given:
    masks = learnable(table, use, OPTIONS.observations)
    observed, _ = observe(chain, table, use, masks.relative, WIDTH, OPTIONS.fold)
    state = start_of(observed)
    system = anchor_system(state, chain_linearised(state, observed.graph), observed)
    return Given(system, contrasts(system, masks), observed, NOISE)


@pytest.fixture(scope="module")
def given(session: tuple[Trajectory, Anchors]) -> Given:
    chain, table = arrays(session)
    return given_at_start(chain, table, table.real, OPTIONS)


def random_contrasts(seed: int, size: float, rows: int = 21, padding: int = 3) -> Contrasts:
    """Contrasts of two components whose noise is `size` times what unit sigmas say."""
    random = np.random.default_rng(seed)
    components = np.zeros((N_COMPONENTS, rows + padding, rows + padding))
    for component in (0, 5):
        part = random.standard_normal((rows, 9))
        components[component, :rows, :rows] = part @ part.T
    drawn = np.eye(rows) + size**2 * components[:, :rows, :rows].sum(axis=0)
    c = np.concatenate([np.linalg.cholesky(drawn) @ random.standard_normal(rows), np.zeros(padding)])
    return contrasts_of(c, np.eye(rows + padding), components, rows)


def test_without_iterations_it_is_the_variance_of_unit_weight():
    found = random_contrasts(0, 2.0)
    sigma = jnp.zeros(N_COMPONENTS).at[jnp.array([0, 5])].set(0.5)
    c, v = np.asarray(found.c), 0.25 * np.asarray(found.components).sum(axis=0)
    expected = np.sqrt(c @ np.linalg.solve(np.eye(24) + v, c) / 21)
    assert scale_factor(found, sigma, iterations=0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("size", [0.5, 5.0])
def test_iterated_it_is_the_likeliest_factor(size: float):
    found = random_contrasts(1, size)
    sigma = jnp.zeros(N_COMPONENTS).at[jnp.array([0, 5])].set(1.0)
    c, v = np.asarray(found.c), np.asarray(found.components).sum(axis=0)

    def negative_log_likelihood(log_s: float) -> float:
        m = np.eye(24) + np.exp(2.0 * log_s) * v
        return 0.5 * float(c @ np.linalg.solve(m, c) + np.linalg.slogdet(m)[1])

    best = float(np.exp(minimize_scalar(negative_log_likelihood, bounds=(-4, 4), method="bounded").x))
    assert scale_factor(found, sigma, iterations=200) == pytest.approx(best, rel=1e-3)
    # One iteration is what is used: near it.
    assert scale_factor(found, sigma) == pytest.approx(best, rel=0.15)


def test_nothing_to_learn_from_leaves_the_fixed_noise():
    nothing = contrasts_of(np.zeros(24), np.eye(24), np.zeros((N_COMPONENTS, 24, 24)), 0)
    assert scale_factor(nothing, jnp.ones(N_COMPONENTS)) == 1.0


def test_the_scaled_noise_keeps_the_fixed_ratios(given: Given):
    scaled = scale_factor_noise(given)
    s = float(scaled.sigma_trans_m_per_sqrt_m[0] / NOISE.sigma_trans_m_per_sqrt_m[0])
    assert s == pytest.approx(float(scale_factor(given.found, ensemble_of(NOISE).sigma[0])))
    assert s > 2.0  # the session drifts more than the defaults say
    jax.tree.map(lambda new, old: np.testing.assert_allclose(new, s * old, rtol=1e-12), scaled, NOISE)


def negative_log_density(error_m: np.ndarray, covariance_m2: np.ndarray) -> float:
    return 0.5 * float(error_m @ np.linalg.solve(covariance_m2, error_m) + np.linalg.slogdet(covariance_m2)[1])


def test_the_closed_form_held_out_loss_is_that_of_leaving_out_and_predicting(given: Given):
    """Each location: weighted least squares of the gauge on the other rows, then the conditional normal of its own."""
    system, observed = given.system, given.observed
    sigma = np.asarray(ensemble_of(NOISE).sigma[0])
    known, location = np.asarray(observed.known), np.asarray(observed.location)
    m = np.asarray(system.base) + np.einsum("c,cxy->xy", sigma**2, np.asarray(system.components))
    h, c = np.asarray(system.jacobian).reshape(-1, 6), np.asarray(system.residual)
    loss = np.asarray(held_out_loss(system, observed, jnp.asarray(sigma)))
    row_location = np.where(np.repeat(known, 3) > 0, np.repeat(location, 3), -1)
    for place in np.unique(location[known > 0]):
        b, a = row_location == place, (row_location != place) & (row_location >= 0)
        inverse = np.linalg.inv(m[np.ix_(a, a)])
        gain = m[np.ix_(b, a)] @ inverse
        normal = np.linalg.inv(h[a].T @ inverse @ h[a])
        gauge = normal @ h[a].T @ inverse @ c[a]
        error = c[b] - h[b] @ gauge - gain @ (c[a] - h[a] @ gauge)
        lever = h[b] - gain @ h[a]
        covariance = m[np.ix_(b, b)] - gain @ m[np.ix_(a, b)] + lever @ normal @ lever.T
        first = int(np.flatnonzero(location == place)[0])
        assert loss[first] == pytest.approx(negative_log_density(error, covariance), rel=1e-7)
    assert np.count_nonzero(loss) == len(np.unique(location[known > 0]))


def test_a_location_that_the_others_cannot_predict_is_left_out_with_its_gradient(session: tuple[Trajectory, Anchors]):
    """Three locations: without any one the frame is free."""
    chain, table = arrays(session)
    use = jnp.asarray(np.isin(np.asarray(table.location), [0, 1, 2]).astype(float))
    few = given_at_start(chain, table, use, OPTIONS)
    assert np.all(np.asarray(held_out_loss(few.system, few.observed, ensemble_of(NOISE).sigma[0])) == 0.0)
    gradient = jax.jit(jax.grad(outer_loss))(jnp.zeros(3), few)
    np.testing.assert_array_equal(gradient, np.zeros(3))


def test_bilevel_finds_scipys_minimum(given: Given):
    loss = jax.jit(jax.value_and_grad(outer_loss))
    found = bilevel_noise(given)
    log_factor = np.log(
        [
            found.sigma_trans_m_per_sqrt_m[0] / NOISE.sigma_trans_m_per_sqrt_m[0],
            found.sigma_rot_rad_per_sqrt_m[0] / NOISE.sigma_rot_rad_per_sqrt_m[0],
            found.sigma_log_scale / NOISE.sigma_log_scale,
        ]
    )
    peer = minimize(lambda x: float(loss(jnp.asarray(x), given)[0]), np.zeros(3), method="Nelder-Mead", tol=1e-8)
    np.testing.assert_allclose(log_factor, peer.x, atol=2e-3)
    assert np.abs(log_factor).max() > 0.5


def test_bilevel_s_loss_has_the_prior_in_it(given: Given):
    """Far from the fixed noise, where the held-out loss is taken away."""
    at = jnp.array([0.7, -0.4, 0.3])
    factor = np.ones(N_COMPONENTS)
    factor[TRANS], factor[ROT], factor[LOG_SCALE] = np.exp(0.7), np.exp(-0.4), np.exp(0.3)
    held_out = held_out_loss(given.system, given.observed, ensemble_of(NOISE).sigma[0] * jnp.asarray(factor))
    prior = float(outer_loss(at, given) - held_out.sum())
    assert prior == pytest.approx(0.5 * np.asarray(at) @ np.linalg.solve(PRIOR_COVARIANCE, np.asarray(at)), rel=1e-6)


def moved(anchors: Anchors, location: int, by_m: float) -> Anchors:
    surveyed = anchors.surveyed_enh_m.copy()
    surveyed[anchors.location_index == location] += by_m
    return dataclasses.replace(anchors, surveyed_enh_m=surveyed)


@pytest.mark.parametrize("estimate", [scale_factor_noise, bilevel_noise])
def test_not_a_bit_of_a_held_out_location_reaches_its_fold(session: tuple[Trajectory, Anchors], estimate):
    _, anchors = session
    chain, table = arrays(session)
    _, elsewhere = arrays(session, moved(anchors, 2, 700.0))
    use = rows(anchors, table, 2, -1)
    found, again = (estimated_folds(chain, t, NOISE, use, WIDTH, OPTIONS, estimate) for t in (table, elsewhere))
    assert bool(found.settled[0])
    np.testing.assert_array_equal(found.point_m[0], again.point_m[0])
    np.testing.assert_array_equal(found.ensemble.sigma[0], again.ensemble.sigma[0])
    # The fold that uses it does see it.
    assert np.abs(np.asarray(found.point_m[1] - again.point_m[1])).max() > 1.0


def test_the_estimate_belongs_to_where_the_fold_settled(session: tuple[Trajectory, Anchors]):
    """Solving under the noise that a fold ended with gives the fold's own prediction."""
    _, anchors = session
    chain, table = arrays(session)
    use = rows(anchors, table, 0, 3)
    found = estimated_folds(chain, table, NOISE, use, WIDTH, OPTIONS, scale_factor_noise)
    for fold in range(2):
        own: NoiseEnsemble = jax.tree.map(lambda x, fold=fold: x[fold], found.ensemble)
        again = transferred_folds(chain, table, own, use[fold : fold + 1], WIDTH, OPTIONS.fold)
        np.testing.assert_allclose(again.point_m[0], found.point_m[fold], atol=5e-4)


def test_true_noise_is_the_ensemble_of_one(session: tuple[Trajectory, Anchors]):
    _, anchors = session
    chain, table = arrays(session)
    use = rows(anchors, table, 0)
    true = odometry_noise(0.02, 0.002, 0.002, 0.0, 0.007, 0.0005)
    folds: list[PointFold] = [
        true_noise_folds(chain, table, true, use, WIDTH, OPTIONS.fold),
        transferred_folds(chain, table, ensemble_of(true), use, WIDTH, OPTIONS.fold),
    ]
    np.testing.assert_array_equal(folds[0].point_m, folds[1].point_m)
    assert bool(folds[0].settled[0])
    twice = NoiseEnsemble(jnp.repeat(ensemble_of(true).sigma, 2, axis=0), jnp.array([0.25, 0.75]), jnp.asarray(1.0))
    same = transferred_folds(chain, table, twice, use, WIDTH, OPTIONS.fold)
    np.testing.assert_allclose(same.error_covariance_m2, folds[0].error_covariance_m2, rtol=1e-6, atol=1e-9)
