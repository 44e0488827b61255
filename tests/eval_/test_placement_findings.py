"""The study of placement's figures: predictions against the estimator's own claim, statistics against known answers."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import spearmanr

from calibration.transfer import transferred_folds
from eval.collinearity import near_collinear, neighbours
from eval.montecarlo.regimes import REGIMES
from eval.montecarlo.settings import SOLVE
from eval.placement.findings import _anchors, _choices, _found, predicted_m2, rank_correlation, visit_sigma_m
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.simulate import UAV, simulate_session
from jaxgeo.simulate.layout import LOCATIONS, ORDER, SURVEYED_ENH_M
from jaxgeo.simulate.true_noise import true_noise

CHOICES = _choices(6)
LEFT_OUT = ~CHOICES[:, [LOCATIONS.index(name) for name in ORDER]]
SESSIONS = 4


def test_choices_are_all_of_three_to_five():
    assert [int((CHOICES.sum(axis=1) == k).sum()) for k in range(7)] == [0, 0, 0, 20, 15, 6, 0]
    assert len(np.unique(CHOICES, axis=0)) == 41


def test_b_and_e_are_the_near_collinear_locations():
    each = neighbours(LOCATIONS, SURVEYED_ENH_M)
    assert near_collinear(each) == {"B", "E"}
    assert {x.name: round(100.0 * x.distance_m, 1) for x in each if x.name in "BE"} == {"B": 201.5, "E": 220.4}


@pytest.mark.parametrize("ties", [False, True])
def test_rank_correlation_is_scipys(ties):
    a, b = np.random.default_rng(3).normal(size=(2, 15))
    if ties:
        a, b = a.round(), b.round()
    assert rank_correlation(a, b) == pytest.approx(np.array(spearmanr(a, b), dtype=float)[0], abs=1e-12)


@pytest.mark.parametrize("share", [1.0, 0.01])
def test_a_prediction_is_what_the_estimator_claims_of_a_path_without_drift(share):
    """On odometry that did not err the corrected path is the planned one, and so must be the held-out variances.

    Sightings are given the covariance that is predicted with, where the estimator's own are more careful. Under a
    hundredth of the drift they and the survey are most of the error.
    """
    regime, layout = REGIMES["white"], dataclasses.replace(UAV, n_poses=200)
    session = simulate_session(0, layout, drift={"odometry": regime.drawn(0)})
    anchors = _anchors(session)
    own_m2 = (visit_sigma_m(layout) ** 2 - SOLVE.extra_sigma_m**2) * np.eye(3)
    anchors = dataclasses.replace(
        anchors,
        stamp_s=session.truth.stamp_s[anchors.pose_index],
        lever_covariance_m2=np.tile(own_m2, (len(anchors), 1, 1)),
    )
    noise = true_noise(session.truth, session.truth, regime.drift)
    noise = NoiseEnsemble(share * noise.sigma, noise.weight, noise.correlation_m)
    predicted = predicted_m2(session, anchors, noise, CHOICES)
    chain = chain_of(session.truth)
    table = anchor_table(anchors, chain, SOLVE.extra_sigma_m)
    use = np.zeros((len(CHOICES), table.real.shape[0]))
    use[:, : len(anchors)] = ~LEFT_OUT
    found = transferred_folds(
        chain, table, noise, jnp.asarray(use), jnp.asarray(SOLVE.loss_width), SOLVE.ensemble_options()
    )
    claimed = np.trace(np.asarray(found.error_covariance_m2), axis1=2, axis2=3)[:, : len(anchors)]
    assert bool(np.asarray(found.settled).all())
    np.testing.assert_allclose(np.sqrt(predicted[LEFT_OUT]), np.sqrt(claimed[LEFT_OUT]), rtol=0.02)


def spread_out(near_m2: float, others_m2: float) -> np.ndarray:
    """Squared errors of one size where B or E is left out, of another elsewhere, with sessions that differ."""
    is_near = np.array([name in "BE" for name in ORDER])
    size = np.where(is_near, near_m2, others_m2)[None, None, :] * np.linspace(0.5, 1.5, SESSIONS)[:, None, None]
    return np.broadcast_to(size, (SESSIONS, *LEFT_OUT.shape)).copy()


def found_of(predicted_m2: np.ndarray, achieved_m2: np.ndarray, failed: int = 0):
    return _found(REGIMES["white"], UAV, LOCATIONS, CHOICES, LEFT_OUT, predicted_m2, achieved_m2, failed)


def test_the_contrast_is_that_of_what_was_put_in():
    found = found_of(spread_out(1.0, 9.0), spread_out(4.0, 16.0))
    assert found.ratio_predicted == pytest.approx(1.0 / 3.0)
    assert (found.near_predicted_m, found.others_predicted_m) == pytest.approx((1.0, 3.0))
    assert (found.near_achieved_m.value, found.others_achieved_m.value) == pytest.approx((2.0, 4.0))
    # Sessions differ in size, near and others alike: the ratio is the same whichever are drawn.
    ratio = found.ratio_achieved
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.5, 0.5, 0.5))
    assert found.near_achieved_m.low < 2.0 < found.near_achieved_m.high


def test_errors_at_anchors_that_were_used_do_not_count():
    predicted, achieved = spread_out(1.0, 9.0), spread_out(4.0, 16.0)
    spoiled = found_of(np.where(LEFT_OUT, predicted, 1e6), np.where(LEFT_OUT, achieved, 1e6))
    assert spoiled == found_of(predicted, achieved)


def test_the_count_row_is_of_the_choice_in_the_middle():
    """Each choice's error is its own size: the median over choices of one k, and the range over them, are known."""
    size = np.zeros(len(CHOICES))
    for k in (3, 4, 5):
        some = CHOICES.sum(axis=1) == k
        size[some] = (10.0 * k + np.arange(some.sum())) ** 2
    every = np.broadcast_to(size[None, :, None], (SESSIONS, *LEFT_OUT.shape)).copy()
    for row in found_of(every, every).counts:
        expected = 10.0 * row.k + np.arange(row.choices)
        assert row.predicted.value == pytest.approx(np.median(expected))
        assert (row.predicted.low, row.predicted.high) == pytest.approx(tuple(np.quantile(expected, [0.16, 0.84])))
        assert row.achieved.value == row.achieved.low == row.achieved.high == pytest.approx(np.median(expected))


def test_the_order_of_choices_of_four():
    sizes = np.random.default_rng(5).uniform(1.0, 2.0, len(CHOICES))
    predicted = np.broadcast_to(sizes[None, :, None], (SESSIONS, *LEFT_OUT.shape)).copy()
    for achieved, expected in ((predicted**3, 1.0), (1.0 / predicted, -1.0)):
        order = found_of(predicted, achieved).order
        assert (order.value, order.low, order.high) == pytest.approx((expected, expected, expected))


def test_a_correction_that_did_not_settle_is_left_out():
    predicted, achieved = (np.repeat(spread_out(*m2), 3, axis=0) for m2 in ((1.0, 9.0), (4.0, 16.0)))
    whole = found_of(predicted, achieved)
    achieved[1, CHOICES.sum(axis=1) == 4] = np.nan
    achieved[2, 0] = np.nan
    found = found_of(predicted, achieved, failed=16)
    assert found.failed == 16
    figures = [x for row in found.counts for x in dataclasses.astuple(row.achieved)]
    assert all(math.isfinite(x) for x in (*figures, *dataclasses.astuple(found.order)))
    assert found.ratio_achieved == whole.ratio_achieved
    assert found.counts[2] == whole.counts[2]
