import itertools

import evo.core.geometry
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from random_poses import random_rotation
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxgeo.geometry import determinacy, sim3_apply, umeyama

K = 7  # one size, so that each variant compiles once
CUBE = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
PLANE = np.random.default_rng(5).normal(size=(K, 3)) * [1.0, 1.0, 0.0]
LINE = np.outer(np.arange(float(K)), [1.0, 2.0, 3.0])
VERTICAL = np.outer(np.arange(float(K)), [0.0, 0.0, 1.0])
POINT = np.full((K, 3), 7.1) * [1.0, 10.0, -0.1]  # its mean is rounded: what is left looks like a tiny cloud


def scene(seed: int, noise: float = 0.3):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(K, 3)) * [30.0, 20.0, 2.0]
    rotation, scale, translation = random_rotation(rng), float(np.exp(rng.normal())), rng.normal(size=3) * 100.0
    target = scale * source @ rotation.T + translation + noise * rng.normal(size=(K, 3))
    return source, target, rng.uniform(0.2, 3.0, K), (scale, rotation, translation)


def fit(source, target, weights=None, **kwargs):
    return umeyama(
        jnp.asarray(source), jnp.asarray(target), None if weights is None else jnp.asarray(weights), **kwargs
    )


def yaw(angle: float) -> np.ndarray:
    return Rotation.from_euler("z", angle).as_matrix()


@given(st.integers(0, 10**6))
def test_recovers_an_exact_similarity(seed):
    source, target, weights, (scale, rotation, translation) = scene(seed, noise=0.0)
    found = fit(source, target, weights)
    assert_allclose(found.sim3.scale, scale, rtol=1e-12)
    assert_allclose(found.sim3.rotation, rotation, atol=1e-11)
    assert_allclose(found.sim3.translation_m, translation, atol=1e-9)
    assert found.rms_m < 1e-10


@given(st.integers(0, 10**6))
def test_order_and_weight_units_do_not_matter(seed):
    source, target, weights, _ = scene(seed)
    order = np.random.default_rng(seed).permutation(K)
    one, other = fit(source, target, weights), fit(source[order], target[order], 1e4 * weights[order])
    assert_allclose(one.sim3.rotation, other.sim3.rotation, atol=1e-12)
    assert_allclose(one.sim3.translation_m, other.sim3.translation_m, atol=1e-10)
    assert_allclose(one.rms_m, other.rms_m, rtol=1e-10)


@pytest.mark.parametrize("scale", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_equal_weights_as_evo(seed, scale):
    source, target, _, _ = scene(seed)
    rotation, translation, factor = evo.core.geometry.umeyama_alignment(source.T, target.T, with_scale=scale)
    found = fit(source, target, scale=scale)
    assert_allclose(found.sim3.rotation, rotation, atol=1e-12)
    assert_allclose(found.sim3.translation_m, translation, atol=1e-10)
    assert_allclose(found.sim3.scale, factor, rtol=1e-12)
    rest = target - (factor * source @ rotation.T + translation)
    assert_allclose(found.rms_m, np.sqrt(np.mean(np.sum(rest**2, axis=1))), rtol=1e-10)


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("scale", [True, False])
def test_weighted_as_scipy_least_squares(scale, gravity):
    source, _, weights, (factor, rotation, translation) = scene(1)
    turned = source @ (yaw(2.5) if gravity else rotation).T
    noise = 0.3 * np.random.default_rng(0).normal(size=(K, 3))
    target = (factor if scale else 1.0) * turned + translation + noise

    def residual(x):
        turn = yaw(x[5]) if gravity else Rotation.from_rotvec(x[3:6]).as_matrix()
        rest = target - ((np.exp(x[6]) if scale else 1.0) * source @ turn.T + x[:3])
        return (np.sqrt(weights)[:, None] * rest).ravel()

    found = fit(source, target, weights, scale=scale, gravity=gravity)
    rotvec = Rotation.from_matrix(np.asarray(found.sim3.rotation)).as_rotvec()
    start = np.concatenate([np.asarray(found.sim3.translation_m), rotvec, [np.log(found.sim3.scale)]]) + 1e-3
    best = least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert_allclose(found.rms_m**2 * weights.sum(), 2.0 * best.cost, rtol=1e-10)
    assert_allclose(found.sim3.translation_m, best.x[:3], atol=1e-5)
    turn = yaw(best.x[5]) if gravity else Rotation.from_rotvec(best.x[3:6]).as_matrix()
    assert_allclose(found.sim3.rotation, turn, atol=1e-7)
    assert found.sim3.scale == 1.0 if not scale else abs(found.sim3.scale - np.exp(best.x[6])) < 1e-7


def test_never_a_reflection():
    """The best proper rotation onto the mirror image: none of many random ones does better."""
    source, _, weights, _ = scene(2)
    target = source * [1.0, 1.0, -1.0]
    found = fit(source, target, weights, scale=False)
    assert_allclose(np.linalg.det(found.sim3.rotation), 1.0, atol=1e-12)
    mean = np.average(source, axis=0, weights=weights)
    rng = np.random.default_rng(0)
    for _ in range(200):
        rest = (target - mean * [1, 1, -1]) - (source - mean) @ random_rotation(rng).T
        assert found.rms_m <= np.sqrt(np.average(np.sum(rest**2, axis=1), weights=weights)) + 1e-12


def test_opposed_heights_under_gravity_keep_a_positive_scale():
    source = np.outer(np.linspace(-1.0, 1.0, K), [0.01, 0.0, 1.0])
    found = fit(source, -source, gravity=True)
    assert found.sim3.scale > 0.0
    assert found.rms_m > 0.1


@pytest.mark.parametrize("gravity", [True, False])
def test_masked_points_do_not_matter_bit_for_bit(gravity):
    source, target, weights, _ = scene(3)
    weights[[1, 4]] = 0.0
    other_source, other_target = source.copy(), target.copy()
    other_source[1], other_target[4], other_target[1] = 1e9, -3.0, np.nan
    one, other = (fit(s, t, weights, gravity=gravity) for s, t in ((source, target), (other_source, other_target)))
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert_array_equal(a, b)
    gradient = jax.grad(lambda s: fit(s, other_target, weights, gravity=gravity).sim3.translation_m.sum())
    found = gradient(jnp.asarray(other_source))
    assert_array_equal(found[jnp.array([1, 4])], 0.0)
    assert np.isfinite(found).all()
    dropped = np.delete(source, [1, 4], 0), np.delete(target, [1, 4], 0), np.delete(weights, [1, 4])
    assert_allclose(one.sim3.translation_m, fit(*dropped, gravity=gravity).sim3.translation_m, atol=1e-9)


def test_all_subsets_in_one_vmap():
    source, target, _, _ = scene(4)
    masks = np.array([[float(i in subset) for i in range(K)] for subset in itertools.combinations(range(K), 4)])
    found = jax.vmap(lambda w: fit(source, target, w))(jnp.asarray(masks))
    for i in (0, 11, 34):
        one = fit(source, target, masks[i])
        assert_allclose(found.sim3.rotation[i], one.sim3.rotation, atol=1e-12)
        assert_allclose(found.rms_m[i], one.rms_m, rtol=1e-9)


def probe(source, target, scale: bool, gravity: bool):
    """A number that every entry of the fit moves."""
    found = umeyama(source, target, scale=scale, gravity=gravity)
    at = jnp.asarray([[0.3, -1.2, 0.7], [2.0, 0.1, -0.4]])
    return jnp.sum(sim3_apply(found.sim3, at) * jnp.asarray([[1.0, 2.0, -3.0], [0.5, 1.0, 4.0]])) + found.rms_m


gradient = jax.jit(jax.grad(probe, (0, 1)), static_argnums=(2, 3))
gradient_forward = jax.jit(jax.jacfwd(probe, (0, 1)), static_argnums=(2, 3))
probe_jit = jax.jit(probe, static_argnums=(2, 3))


@pytest.mark.parametrize(("scale", "gravity"), [(True, False), (False, False), (True, True)])
@pytest.mark.parametrize("points", [scene(6)[0] / 10.0, CUBE, PLANE], ids=["general", "coincident", "planar"])
def test_gradient_against_differences(points, scale, gravity):
    """Coincident singular values (cube), a zero one (plane): the rotation has a derivative, its decomposition none."""
    rng = np.random.default_rng(0)
    turn = yaw(0.7) if gravity else random_rotation(rng)
    target = 1.3 * points @ turn.T + 0.01 * rng.normal(size=points.shape) * (points is not CUBE) + [0.0, 0.0, 1.0]
    if points is CUBE:
        target[4] += 0.1  # at the centre: leaves the singular values equal, and a residual, or rms has no derivative
    found = gradient(jnp.asarray(points), jnp.asarray(target), scale, gravity)
    direction = rng.normal(size=(2, K, 3))
    step = 1e-6
    ends = [
        float(probe_jit(jnp.asarray(points + s * direction[0]), jnp.asarray(target + s * direction[1]), scale, gravity))
        for s in (step, -step)
    ]
    ours = float(jnp.sum(found[0] * direction[0]) + jnp.sum(found[1] * direction[1]))
    assert_allclose(ours, (ends[0] - ends[1]) / (2.0 * step), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(("scale", "gravity"), [(True, False), (False, False), (True, True)])
@pytest.mark.parametrize(
    "points",
    [CUBE, PLANE, LINE, VERTICAL, POINT, 0.0 * POINT],
    ids=["cube", "plane", "line", "vertical", "point", "zero"],
)
@pytest.mark.parametrize("moved", ["same", "turned", "mirrored"])
def test_degenerate_configurations_give_finite_gradients(points, moved, scale, gravity):
    target = {
        "same": points,
        "turned": points @ random_rotation(np.random.default_rng(1)).T + 3.0,
        "mirrored": points * [1.0, 1.0, -1.0],
    }[moved]
    arguments = jnp.asarray(points), jnp.asarray(target), scale, gravity
    for part in (*gradient(*arguments), *gradient_forward(*arguments)):
        assert np.isfinite(part).all()
    found = fit(points, target, scale=scale, gravity=gravity)
    assert_allclose(np.linalg.det(found.sim3.rotation), 1.0, atol=1e-12)
    assert found.sim3.scale > 0.0
    assert found.sim3.scale == 1.0 or points is not POINT  # not the ratio of two rounding errors


def test_second_derivative_is_finite():
    source, target, _, _ = scene(7)
    hessian = jax.jit(jax.hessian(lambda t: probe(jnp.asarray(source), t, True, False)))(jnp.asarray(target))
    assert np.isfinite(hessian).all()
    assert_allclose(hessian, np.transpose(hessian, (2, 3, 0, 1)), atol=1e-8)


def test_determinacy_is_the_spread_along_the_axes():
    turn = random_rotation(np.random.default_rng(0))
    box = np.array(list(itertools.product([-1.0, 1.0], repeat=3))) * [3.0, 2.0, 1.0] @ turn.T + 50.0
    assert_allclose(determinacy(jnp.asarray(box)), [3.0, 2.0, 1.0], atol=1e-12)
    assert_allclose(determinacy(jnp.asarray(LINE))[1:], 0.0, atol=1e-13)
    weights = np.array([1.0, 1.0, 0, 0, 0, 0, 0, 0])
    assert_allclose(determinacy(jnp.asarray(box), jnp.asarray(weights)), [1.0, 0.0, 0.0], atol=1e-12)
    assert determinacy(jnp.ones((1, 3))).shape == (3,)
