"""Predicted accuracy against the estimator's own covariance; its derivatives against differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from eval_.placement_problem import SIGHT, SIGHTING_M, SURVEY_M, loop, small_plan, small_problem, two_sets
from scipy.spatial.transform import Rotation

from eval.loo import correct_under_and_hold_out
from eval.placement.candidates import equal_spacing
from eval.placement.criteria import CRITERIA, criterion_m, robust_criterion_m
from eval.placement.plan import place_at_stamp, plan_of, position_at
from eval.placement.plan_drift import carried, own_covariance
from eval.placement.plan_visits import Visits
from eval.placement.predicted import Watched, covariance_given, watched
from eval.placement.problem import Problem, accuracy, accuracy_m
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.components import BOUNDED, NoiseEnsemble
from jaxgeo.solve.correct import Settings

INDEX = np.array([6, 120, 240, 400, 520, 592])


def anchors(path: Trajectory) -> Anchors:
    """Markers two metres ahead of these poses; the last one is the first one's, seen again."""
    k, turn = len(INDEX), Rotation.from_quat(path.quat_wxyz[INDEX], scalar_first=True)
    point = turn.apply([2.0, 1.0, 0.3]) + path.position_m[INDEX]
    point[-1] = point[0]
    none, eye = np.full((k, 4), np.nan), np.eye(3)
    return Anchors(
        tuple(f"v{i}" for i in range(k)),
        (*(f"L{i}" for i in range(k - 1)), "L0"),
        np.append(np.arange(k - 1), 0),
        INDEX,
        turn.inv().apply(point - path.position_m[INDEX]),
        np.tile(SIGHTING_M**2 * eye, (k, 1, 1)),
        point,
        np.tile(SURVEY_M**2 * eye, (k, 1, 1)),
        none,
        none,
        np.zeros((k, 3, 3)),
        np.full(k, SIGHTING_M),
        np.ones(k, int),
        path.stamp_s[INDEX],
    )


def visits_of(given: Anchors, plan) -> Visits:
    return Visits(
        place_at_stamp(plan, jnp.asarray(given.stamp_s)),
        jnp.asarray(given.surveyed_enh_m),
        jnp.ones(len(given)),
        jnp.asarray(given.location_index),
    )


def test_predicted_is_what_the_estimator_claims():
    path, noise = loop(), two_sets()
    given = anchors(path)
    found, _ = correct_under_and_hold_out(path, given, Settings(), noise, None)
    plan = plan_of(path)
    rows = np.arange(0, len(path), 25)
    place = place_at_stamp(plan, jnp.asarray(path.stamp_s[rows]))
    points = carried(plan, noise, place, position_at(plan, place))
    watch = Watched(points, own_covariance(points, plan, noise))
    each = covariance_given(visits_of(given, plan), plan, noise, watch, SIGHT)
    predicted = np.einsum("q,qmab->mab", noise.weight, each)
    claimed = found.covariance[rows, :3, :3]
    # The estimator's stretches of a wandering bias end at poses, the plan's anywhere: hence not to the last digit.
    np.testing.assert_allclose(predicted, claimed, atol=0.005 * np.trace(claimed, axis1=1, axis2=2).max())


@pytest.mark.parametrize("kind", CRITERIA)
def test_gradients_in_the_markers_places_are_differences(kind):
    problem = small_problem(criterion=kind)
    point = equal_spacing(4, problem) + np.array(
        [[0.3, -0.2, 0.1], [1.0, 0.5, 0.0], [-0.7, 0.2, 0.0], [0.4, -0.6, 0.0]]
    )
    # `worst` and `E` are searched as power means; their own largest value has the same derivative but for ties.
    value = eqx.filter_jit(lambda p: accuracy_m(p, problem, smooth=True))
    gradient = np.asarray(jax.grad(value)(jnp.asarray(point)))
    for row, axis in ((0, 0), (1, 1), (3, 0)):
        step = np.zeros_like(point)
        step[row, axis] = 1e-4
        ahead, back = (float(value(jnp.asarray(point + s * step))) for s in (1.0, -1.0))
        assert gradient[row, axis] == pytest.approx((ahead - back) / 2e-4, rel=1e-5, abs=1e-10)


def test_gradients_in_stamps_and_noise_are_differences():
    path, plan = loop(), small_plan(wanders=True)
    given = anchors(path)
    noise = eqx.tree_at(lambda n: n.sigma, two_sets(), two_sets().sigma.at[:, BOUNDED].set(0.03))

    @jax.jit
    def value(stamp_s, log_sigma):
        changed = NoiseEnsemble(noise.sigma * jnp.exp(log_sigma)[None], noise.weight, noise.correlation_m)
        visits = eqx.tree_at(lambda v: v.place, visits_of(given, plan), place_at_stamp(plan, stamp_s))
        found = covariance_given(visits, plan, changed, watched(plan, changed, 8), SIGHT)
        return robust_criterion_m(found, changed.weight, "path", "mean")

    at = (jnp.asarray(given.stamp_s + 0.013), jnp.zeros(noise.sigma.shape[1]))
    gradient = jax.grad(value, argnums=(0, 1))(*at)
    for argument, entries in ((0, (1, 3, 5)), (1, range(15))):
        for entry in entries:
            step = [jnp.zeros_like(a) for a in at]
            step[argument] = step[argument].at[entry].set(1e-5)
            ahead, back = (float(value(*(a + s * d for a, d in zip(at, step, strict=True)))) for s in (1.0, -1.0))
            assert float(gradient[argument][entry]) == pytest.approx((ahead - back) / 2e-5, rel=1e-4, abs=1e-9)


def test_what_a_layout_is_made_of(subtests):
    problem = small_problem()
    point = jnp.asarray(equal_spacing(4, problem))
    base = float(accuracy(point, problem))
    standing: Problem = eqx.tree_at(lambda p: p.standing_m, problem, point[3:])
    better = eqx.tree_at(lambda p: p.sight.survey_sigma_m, problem, jnp.full(3, 0.001))
    with subtests.test("a better survey helps"):
        assert float(accuracy(point, better)) < base
    with subtests.test("a marker that stands already is one of the layout"):
        assert float(accuracy(point[:3], standing)) == pytest.approx(base, rel=1e-12)
    with subtests.test("two markers leave the frame free"):
        assert float(accuracy(point[:2], problem)) > 1e4


def test_criteria_of_equal_balls_are_their_size():
    balls = jnp.broadcast_to(0.04 * jnp.eye(3), (5, 3, 3))
    found = {kind: float(criterion_m(balls, kind)) for kind in CRITERIA}
    assert found == pytest.approx({"path": 0.2 * 3**0.5, "worst": 0.2 * 3**0.5, "D": 0.2, "E": 0.2})


def test_what_robust_averages(subtests):
    sets = jnp.stack([jnp.broadcast_to(s**2 * jnp.eye(3), (4, 3, 3)) for s in (0.1, 0.3)])
    weight = jnp.array([0.75, 0.25])
    expected = {"mixture": (0.75 * 0.01 + 0.25 * 0.09) ** 0.5, "mean": 0.75 * 0.1 + 0.25 * 0.3, "worst": 0.3}
    for robust, sigma in expected.items():
        with subtests.test(robust):
            found = float(robust_criterion_m(sets, weight, "E", robust))
            assert found == pytest.approx(sigma)


def test_points_beside_a_straight_path_feel_the_turn_about_it():
    n, noise = 130, two_sets()
    along = np.column_stack([np.linspace(0.0, 60.0, n), np.zeros((n, 2))])
    plan = plan_of(Trajectory(np.arange(float(n)), along, np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))))
    point = along[[5, 60, 125]]
    aside = point + np.array([[0.0, 2.0, 0.0], [0.0, -2.0, 0.0], [0.0, 2.0, 0.0]])
    place = place_at_stamp(plan, jnp.array([5.0, 60.0, 125.0]))

    @jax.jit
    def worst_m(at, beside_m):
        watch = watched(plan, noise, 6, beside_m=beside_m)
        visits = Visits(place, at, jnp.ones(3), jnp.arange(3))
        found = covariance_given(visits, plan, noise, watch, SIGHT)
        return jnp.sqrt(jnp.max(jnp.trace(found, axis1=2, axis2=3)))

    assert float(worst_m(point, 0.0)) < 1.0 < 1e4 < float(worst_m(point, 1.0))
    assert float(worst_m(aside, 1.0)) < 1.0
