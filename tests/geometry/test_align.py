import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from random_poses import random_rotation
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from jaxgeo.errors import ConfigError
from jaxgeo.geometry import align, robust_rho, umeyama

K = 8


def scene(seed: int, rotation: np.ndarray | None = None):
    """Points, their noisy images, full covariances of the noise, and the truth."""
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(K, 3)) * [30.0, 20.0, 3.0] + [40.0, -30.0, 5.0]
    rotation = random_rotation(rng) if rotation is None else rotation
    axes = Rotation.random(K, rng=rng).as_matrix()
    root = axes * rng.choice([0.02, 0.1, 0.5], (K, 1, 3))
    covariance = root @ root.transpose(0, 2, 1)
    noise = np.einsum("kij,kj->ki", root, rng.normal(size=(K, 3)))
    target = 1.07 * source @ rotation.T + [10.0, 20.0, 30.0] + noise
    return source, target, covariance, rotation


def run(source, target, covariance, mask=None, **kwargs):
    mask = jnp.ones(K, dtype=bool) if mask is None else jnp.asarray(mask)
    return align(jnp.asarray(source), jnp.asarray(target), jnp.asarray(covariance), mask, **kwargs)


def objective(x, at, source, target, covariance, loss):
    """1/2 sum rho in (translation added, rotation on the left, log-scale added), in NumPy."""
    turn = Rotation.from_rotvec(x[3:6]).as_matrix() @ np.asarray(at.rotation)
    rest = target - (np.exp(x[6]) * float(at.scale) * source @ turn.T + np.asarray(at.translation_m) + x[:3])
    squared = np.einsum("ki,kij,kj->k", rest, np.linalg.inv(covariance), rest)
    return 0.5 * float(np.sum(robust_rho(jnp.asarray(squared), loss, 3.0)))


@pytest.mark.parametrize(("scale", "gravity"), [(True, False), (False, False), (True, True)])
def test_isotropic_noise_is_the_closed_form(scale, gravity):
    source, target, _, _ = scene(0, Rotation.from_euler("z", -1.0).as_matrix() if gravity else None)
    sigma = np.random.default_rng(1).uniform(0.02, 0.5, K)
    closed = umeyama(jnp.asarray(source), jnp.asarray(target), jnp.asarray(sigma**-2), scale=scale, gravity=gravity)
    found = run(source, target, sigma[:, None, None] ** 2 * np.eye(3), scale=scale, gravity=gravity)
    assert found.result == optx.RESULTS.successful
    assert_allclose(found.sim3.scale, closed.sim3.scale, rtol=0, atol=1e-9)
    assert_allclose(found.sim3.rotation, closed.sim3.rotation, rtol=0, atol=1e-9)
    assert_allclose(found.sim3.translation_m, closed.sim3.translation_m, rtol=0, atol=1e-9)
    assert_allclose(2.0 * found.cost, closed.rms_m**2 * np.sum(sigma**-2), rtol=1e-10)
    fixed = [i for i in range(7) if (gravity and i in (3, 4)) or (not scale and i == 6)]
    assert_array_equal(found.covariance[jnp.array(fixed, dtype=int)], 0.0)


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy", "geman_mcclure"])
def test_no_neighbour_is_better(loss):
    """SciPy, started at the answer and told the cost in its own words, finds nothing lower."""
    source, target, covariance, _ = scene(1)
    target[2] += 2.0
    found = run(source, target, covariance, loss=loss)
    assert found.result == optx.RESULTS.successful
    data = (found.sim3, source, target, covariance, loss)
    assert_allclose(found.cost, objective(np.zeros(7), *data), rtol=1e-10)
    units = np.sqrt(np.diagonal(found.covariance))
    best = minimize(lambda x: objective(x * units, *data), np.full(7, 0.3), method="BFGS", options={"gtol": 1e-9})
    assert best.fun >= found.cost * (1.0 - 1e-9)
    assert_allclose(best.x, 0.0, atol=1e-3)


def test_closer_than_the_closed_form_where_covariances_differ():
    errors = []
    for seed in range(20):
        source, target, covariance, rotation = scene(seed)
        fits = (run(source, target, covariance).sim3, umeyama(jnp.asarray(source), jnp.asarray(target)).sim3)
        errors.append([np.linalg.norm(fit.rotation @ rotation.T - np.eye(3)) for fit in fits])
    full, closed = np.sqrt(np.mean(np.square(errors), axis=0))
    assert full < 0.8 * closed


def test_covariance_of_the_parameters():
    """Over many draws the normalised squared error of (t, R, log s) has mean 7."""
    nees = []
    for seed in range(60):
        source, target, covariance, rotation = scene(seed)
        found = run(source, target, covariance)
        turn = Rotation.from_matrix(rotation @ np.asarray(found.sim3.rotation).T).as_rotvec()
        shift = np.array([10.0, 20.0, 30.0]) - np.asarray(found.sim3.translation_m)
        error = np.concatenate([shift, turn, [np.log(1.07 / found.sim3.scale)]])
        nees.append(error @ np.linalg.solve(found.covariance, error))
    assert 7.0 - 4 * np.sqrt(14 / 60) < np.mean(nees) < 7.0 + 4 * np.sqrt(14 / 60)


def test_an_outlier_is_weighted_down():
    errors = []
    for seed in range(6):
        source, target, covariance, rotation = scene(seed)
        target[5] += [8.0, -6.0, 4.0]
        plain, robust = run(source, target, covariance), run(source, target, covariance, loss="geman_mcclure")
        assert robust.weight[5] < 1e-3
        assert np.median(robust.weight) > 0.5
        assert_allclose(robust.residual_m[5], [8.0, -6.0, 4.0], atol=2.0)
        errors.append([np.linalg.norm(fit.sim3.rotation @ rotation.T - np.eye(3)) for fit in (plain, robust)])
    plain_rms, robust_rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert robust_rms < 0.1 * plain_rms


def test_masked_points_do_not_matter_bit_for_bit():
    source, target, covariance, _ = scene(3)
    mask = np.arange(K) != 2
    one = run(source, target, covariance, mask, loss="huber")
    source[2], target[2], covariance[2] = 1e7, np.nan, np.nan
    other = run(source, target, covariance, mask, loss="huber")
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert_array_equal(a, b)
    assert other.weight[2] == 0.0


def probe(target, source, covariance):
    found = align(source, target, covariance, loss="cauchy")  # and no mask
    return found.sim3.scale + jnp.sum(found.sim3.rotation[0])


probe_gradient = jax.jit(jax.grad(probe))


def test_gradient_against_differences():
    source, target, covariance = (jnp.asarray(x) for x in scene(4)[:3])
    direction = jnp.asarray(np.random.default_rng(0).normal(size=(K, 3)))
    step = 3e-4  # the solver stops within 1e-9 of the optimum, which a smaller step would see
    ends = [probe(target + s * direction, source, covariance) for s in (step, -step)]
    ours = jnp.sum(probe_gradient(target, source, covariance) * direction)
    assert_allclose(ours, (ends[0] - ends[1]) / (2.0 * step), rtol=5e-4)


@pytest.mark.parametrize(
    "points", [np.outer(np.arange(float(K)), [1.0, 2.0, 3.0]), np.full((K, 3), 7.1), np.zeros((K, 3))]
)
def test_undetermined_is_finite_with_a_huge_variance(points):
    covariance = np.broadcast_to(0.01 * np.eye(3), (K, 3, 3))
    found = run(points, points + 1.0, covariance, loss="cauchy")
    assert np.isfinite(found.covariance).all()
    assert found.covariance[3:6, 3:6].trace() > 1e6
    gradient = probe_gradient(jnp.asarray(points + 1.0), jnp.asarray(points), jnp.asarray(covariance))
    assert np.abs(gradient).max() < 10.0


def test_too_few_steps_are_reported_not_raised():
    source, target, covariance, _ = scene(5)
    assert run(source, target, covariance, max_steps=2).result != optx.RESULTS.successful


def test_new_data_does_not_compile_anew(caplog):
    run(*scene(6)[:3])
    with jax.log_compiles():
        run(*scene(7)[:3])
    assert not [record for record in caplog.records if "Compiling" in record.getMessage()]


def test_unknown_loss():
    with pytest.raises(ConfigError, match="'tukey' is unknown"):
        run(*scene(0)[:3], loss="tukey")
