"""What corrections do to sightings, how sightings move with them, and what single visits say of them."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from jaxgeo.data import Sightings, Trajectory, Visit
from jaxgeo.errors import InputError
from jaxgeo.solve.corrections import (
    ARM,
    N_CORRECTIONS,
    ROTATION,
    TIME,
    CorrectionPrior,
    compose,
    corrected_sightings,
    motion_seen,
    visits_within,
)
from jaxgeo.solve.corrections_difference import choose_difference
from jaxgeo.solve.corrections_within import first_weights, reduced, within_information, within_visits

PRIOR = CorrectionPrior(time_offset_s=0.1, lever_arm_m=0.05, rotation_rad=0.02)
RATE_HZ, DURATION_S, VISIT_S = 20.0, 60.0, 3.0
SIGMA_M = 0.01
WRONG = np.array([0.15, 0.03, -0.04, 0.02, 0.01, -0.02, 0.015])


def swaying(jitter_m: float = 0.0) -> Trajectory:
    """A rig that walks, sways, tilts and turns to and fro."""
    stamp_s = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    position_m = np.column_stack([0.5 * stamp_s, 0.3 * np.sin(2.1 * stamp_s), 0.1 * np.sin(1.3 * stamp_s)])
    angles = np.column_stack([0.8 * np.sin(0.9 * stamp_s), 0.2 * np.sin(1.7 * stamp_s), 0.3 * np.sin(1.1 * stamp_s)])
    quat = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True)
    walk_m = np.cumsum(jitter_m * np.random.default_rng(5).standard_normal((len(stamp_s), 3)), axis=0)
    return Trajectory(stamp_s, position_m + walk_m, quat)


def seen_from(truth: Trajectory, seed: int = 0, sigma_m: float = SIGMA_M) -> tuple[Sightings, tuple[Visit, ...]]:
    """Ten visits of three seconds, each of a marker a few metres off."""
    random = np.random.default_rng(seed)
    begin = np.searchsorted(truth.stamp_s, np.arange(3.0, 53.0, 5.0))
    rows = [first + np.arange(int(VISIT_S * RATE_HZ)) for first in begin]
    t, visits = [], []
    for i, some in enumerate(rows):
        marker_m = truth.position_m[some].mean(axis=0) + random.uniform(-4.0, 4.0, 3)
        turn = Rotation.from_quat(truth.quat_wxyz[some], scalar_first=True)
        t.append(turn.inv().apply(marker_m - truth.position_m[some]))
        first = i * len(some)
        start_s, end_s = (float(s) for s in truth.stamp_s[some[[0, -1]]])
        visits.append(Visit("m", first + np.arange(len(some)), start_s, end_s, f"L{i}", f"L{i}"))
    index, n = np.concatenate(rows), sum(map(len, rows))
    sightings = Sightings(
        stamp_s=truth.stamp_s[index],
        marker=np.full(n, "m"),
        t_body_marker_m=np.concatenate(t) + sigma_m * random.standard_normal((n, 3)),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=np.tile(np.diag([SIGMA_M**2] * 3 + [0.0] * 3), (n, 1, 1)),
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"row {i}" for i in range(n)]),
    )
    return sightings, tuple(visits)


def recorded(sightings: Sightings, wrong: np.ndarray) -> Sightings:
    """As a rig gives them that needs the corrections `wrong`."""
    turn = Rotation.from_rotvec(wrong[ROTATION]).inv()
    return dataclasses.replace(
        sightings,
        stamp_s=sightings.stamp_s - wrong[TIME],
        t_body_marker_m=turn.apply(sightings.t_body_marker_m - wrong[ARM]),
    )


def within_estimate(
    trajectory: Trajectory, sightings: Sightings, visits: tuple[Visit, ...], rounds: int = 6
) -> tuple[np.ndarray, np.ndarray, float]:
    """From single visits and the prior alone: value, covariance, and kappa at the end."""
    visits = visits_within(trajectory, sightings, visits, PRIOR.reach_s)
    value, log_sigma, difference_s, excess = np.zeros(N_CORRECTIONS), None, 0.1, 1.0
    for turn in range(rounds):
        found = within_information(
            within_visits(trajectory, sightings, visits, value, difference_s), -value, PRIOR.sigma, log_sigma
        )
        log_sigma = found.log_sigma
        covariance = np.linalg.inv(found.information + np.diag(PRIOR.sigma**-2))
        value = value + covariance @ (found.pull - value / PRIOR.sigma**2)
        if turn == rounds - 3:
            difference_s, excess = choose_difference(
                lambda v, d: within_visits(trajectory, sightings, visits, v, d), value, found, PRIOR.sigma, 0.05
            )
    return value, covariance, excess


def test_corrections_undo_what_made_them_needed():
    sightings, _ = seen_from(swaying())
    quat = Rotation.random(len(sightings), rng=np.random.default_rng(1)).as_quat(scalar_first=True)
    sightings = dataclasses.replace(sightings, quat_body_marker_wxyz=quat)
    found = corrected_sightings(recorded(sightings, WRONG), WRONG)
    assert_allclose(found.stamp_s, sightings.stamp_s, atol=1e-12)
    assert_allclose(found.t_body_marker_m, sightings.t_body_marker_m, atol=1e-12)
    turned = Rotation.from_rotvec(WRONG[ROTATION]) * Rotation.from_quat(quat, scalar_first=True)
    assert_allclose(
        (turned.inv() * Rotation.from_quat(found.quat_body_marker_wxyz, scalar_first=True)).magnitude(), 0.0, atol=1e-7
    )


@pytest.mark.parametrize("i", range(N_CORRECTIONS))
def test_the_derivative_is_what_the_positions_do(i):
    truth = swaying()
    sightings, visits = seen_from(truth, sigma_m=0.0)
    rows = [v.sightings for v in visits]
    # Stamps on poses: there interpolation has a corner, which the difference steps over evenly.
    step = 0.05 if i == TIME else 1e-6
    ahead, behind = (np.eye(N_CORRECTIONS)[i] * step * sign for sign in (1.0, -1.0))
    moved = (
        compose(truth, sightings, rows, ahead, 0.05).position_m
        - compose(truth, sightings, rows, behind, 0.05).position_m
    )
    claimed = compose(truth, sightings, rows, np.zeros(N_CORRECTIONS), 0.05).jacobian[:, :, i]
    assert_allclose(moved / (2.0 * step), claimed, atol=1e-7)


def test_with_scatter_alone_information_is_that_of_rows_about_their_means():
    truth = swaying()
    sightings, visits = seen_from(truth)
    data = within_visits(truth, sightings, visits[:3], np.zeros(N_CORRECTIONS), 0.05)
    only_scatter = jnp.asarray([np.log(2.0), -30.0, -30.0, -30.0, -30.0])
    found = reduced(only_scatter, data, first_weights(data))
    assert data.real.shape[0] > 3  # padded to a bucket
    for v in range(3):
        n = int(data.real[v].sum())
        about, off_m = np.asarray(data.jacobian[v, :n]), np.asarray(data.position_m[v, :n])
        about, off_m = about - about.mean(axis=0), off_m - off_m.mean(axis=0)
        information = np.einsum("iax,iay->xy", about, about) / (2.0 * SIGMA_M) ** 2
        assert_allclose(found.information[v], information, rtol=1e-9, atol=1e-6)
        assert_allclose(
            found.pull[v], np.einsum("iax,ia->x", about, off_m) / (2.0 * SIGMA_M) ** 2, rtol=1e-6, atol=1e-6
        )
    assert_allclose(found.information[3:], 0.0)


def test_single_visits_tell_clock_and_camera_of_a_rig_that_moves():
    truth = swaying()
    sightings, visits = seen_from(truth)
    value, covariance, excess = within_estimate(truth, recorded(sightings, WRONG), visits)
    sigma = np.sqrt(np.diag(covariance))
    assert sigma[TIME] < 0.002
    assert abs(value[TIME] - WRONG[TIME]) < 0.004
    assert np.all(np.abs(value - WRONG) < 3.5 * sigma)
    assert excess < 1.5


def test_a_rig_that_stands_still_tells_nothing():
    truth = swaying()
    still = Trajectory(truth.stamp_s, np.zeros_like(truth.position_m), np.tile([1.0, 0.0, 0.0, 0.0], (len(truth), 1)))
    sightings, visits = seen_from(still)
    value, covariance, _ = within_estimate(still, recorded(sightings, WRONG), visits, rounds=4)
    assert_allclose(np.sqrt(np.diag(covariance)), PRIOR.sigma, rtol=0.02)
    assert np.all(np.abs(value) < 0.02 * PRIOR.sigma)
    motion = motion_seen(still, sightings, visits, np.zeros(N_CORRECTIONS), 0.1)
    assert motion.speed_m_s == motion.turn_rad_s == motion.smear_m_s == 0.0
    assert_allclose(motion.axis_turn, 0.0, atol=1e-7)


def test_jitter_of_the_odometry_is_not_counted_as_motion():
    truth = swaying()
    sightings, visits = seen_from(truth, sigma_m=0.03)
    slow = Trajectory(truth.stamp_s, 0.1 * truth.position_m, truth.quat_wxyz)
    walk_m = np.cumsum(0.01 * np.random.default_rng(5).standard_normal(truth.position_m.shape), axis=0)
    jittering = Trajectory(slow.stamp_s, slow.position_m + walk_m, slow.quat_wxyz)
    visits = visits_within(truth, sightings, visits, PRIOR.reach_s)
    zero = np.zeros(N_CORRECTIONS)

    def chosen(of: Trajectory) -> float:
        found = within_information(within_visits(of, sightings, visits, zero, 0.02), zero, PRIOR.sigma)
        return choose_difference(
            lambda v, d: within_visits(of, sightings, visits, v, d), zero, found, PRIOR.sigma, 0.05
        )[0]

    assert chosen(jittering) > 0.02


def test_every_offset_is_judged_by_the_same_sightings():
    truth = swaying()
    sightings, visits = seen_from(truth)
    late = dataclasses.replace(sightings, stamp_s=sightings.stamp_s - 3.0)
    kept = visits_within(truth, late, visits, 0.3)
    assert [v.label for v in kept] == [v.label for v in visits]
    assert kept[0].count < visits[0].count
    assert late.stamp_s[kept[0].sightings].min() >= 0.3
    assert kept[0].start_s == late.stamp_s[kept[0].sightings[0]]
    assert visits_within(truth, dataclasses.replace(late, stamp_s=late.stamp_s + 100.0), visits, 0.3) == ()


@pytest.mark.parametrize(
    ("widths", "words"), [((-0.1, 0.0, 0.0), "-0.1"), ((0.0, np.nan, 0.0), "nan"), ((0.0,) * 3, "all widths")]
)
def test_widths_that_make_no_prior_are_refused(widths, words):
    with pytest.raises(InputError, match=words):
        CorrectionPrior(*widths)
