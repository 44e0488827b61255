"""Corrections from visits and survey together: the algebra against a dense oracle, a simulated session end to end."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import calibration.corrections_folds as folds
from calibration.calibrate import LearnSettings
from calibration.corrections import CorrectionEstimate, estimate_corrections
from calibration.corrections_between import Between, posterior_of_corrections
from calibration.corrections_problem import corrected_anchors, lever_arm_derivative, problem_of
from calibration.corrections_words import corrections_of
from calibration.models import family_prior
from calibration.reml import Contrasts
from jaxgeo.associate import cut_visits, label_visits
from jaxgeo.data import Sightings
from jaxgeo.graph.components import N_COMPONENTS, NoiseEnsemble
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.simulate.layout import ORIGIN_ENH_M, Layout
from jaxgeo.simulate.session import DENSE_DRIFT, simulate_session
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.corrections import ARM, CORRECTIONS, N_CORRECTIONS, ROTATION, TIME, CorrectionPrior, Motion

PRIOR = CorrectionPrior(time_offset_s=0.1, lever_arm_m=0.05, rotation_rad=0.02)
PASSING = Layout("passing", (40,) * 7, (0.02,) * 7, 80.0, 800, rig_height_m=1.0, stream=7)
NOISE = default_noise("lidar")
FAMILY = family_prior("lidar", NOISE)
# Two models of the family: half a minute less of compiling and learning.
LEARN = LearnSettings("lidar", NOISE, prior=dataclasses.replace(FAMILY, free=FAMILY.free[:2]))


@pytest.fixture(scope="module")
def passing():
    """Trajectory, sightings, visits and survey of a rig that passes seven markers."""
    session = simulate_session(3, PASSING, drift={"dense": DENSE_DRIFT}, visit_sigma_m=0.01)
    visits, _ = label_visits(cut_visits(session.sightings, 1.5), session.survey, order=session.order)
    return session.trajectories["dense"], session.sightings, visits, session.survey


def estimated(trajectory, sightings, visits, survey, prior=PRIOR) -> CorrectionEstimate:
    return estimate_corrections(
        trajectory,
        sightings,
        visits,
        survey,
        origin_enh_m=ORIGIN_ENH_M,
        settings=Settings(),
        learn=LEARN,
        prior=prior,
    )


def test_the_posterior_is_that_of_the_joint_normal_distribution():
    random = np.random.default_rng(0)
    m = 12
    x = random.standard_normal((m, N_CORRECTIONS))
    root = np.tril(random.standard_normal((N_CORRECTIONS, N_CORRECTIONS)))
    root[2] = 0.0  # one that is not estimated
    mean, c = root @ random.standard_normal(N_CORRECTIONS), random.standard_normal(m)
    parts = [a @ a.T for a in random.standard_normal((N_COMPONENTS, m, m))]
    found = Contrasts(
        jnp.zeros(m), jnp.eye(m), jnp.asarray(parts), jnp.eye(m), jnp.asarray(float(m)), jnp.zeros((1, m))
    )
    sigma, weight = np.exp(random.standard_normal((3, N_COMPONENTS))), np.array([0.5, 0.3, 0.2])
    noise = NoiseEnsemble(jnp.asarray(sigma), jnp.asarray(weight), jnp.ones(()))
    before = Between(jnp.asarray(mean), jnp.asarray(root))
    got_mean, got, information = posterior_of_corrections(found, jnp.asarray(c), jnp.asarray(x), before, noise)
    means, covariances, told = [], [], []
    for own in sigma:
        noise_covariance = np.eye(m) + np.einsum("c,cxy->xy", own**2, np.array(parts))
        p = root @ root.T
        gain = -p @ x.T @ np.linalg.inv(noise_covariance + x @ p @ x.T)
        means.append(mean + gain @ c)
        covariances.append(p + gain @ x @ p)
        told.append(x.T @ np.linalg.inv(noise_covariance) @ x)
    centre = weight @ np.array(means)
    apart = np.array(means) - centre
    assert_allclose(got_mean, centre, atol=1e-9)
    assert_allclose(got, np.einsum("q,qab->ab", weight, covariances) + (weight[:, None] * apart).T @ apart, atol=1e-9)
    assert_allclose(information, np.einsum("q,qab->ab", weight, told), atol=1e-9)
    assert got_mean[2] == mean[2] == got[2, 2] == 0.0


@pytest.mark.parametrize("i", range(1, N_CORRECTIONS))
def test_lever_arms_move_as_their_derivative_says(passing, i):
    trajectory, sightings, visits, survey = passing
    step = 1e-5 * np.eye(N_CORRECTIONS)[i]
    ahead, behind, at = (
        corrected_anchors(trajectory, sightings, visits, survey, value, origin_enh_m=ORIGIN_ENH_M)[0]
        for value in (step, -step, 0.0 * step)
    )
    claimed = lever_arm_derivative(trajectory, sightings, visits, at, 0.0 * step, 0.1)[:, :, i]
    # Not to the digit: a centroid also weighs sightings by how well they agree and how near its pose they are.
    off = (ahead.lever_arm_m - behind.lever_arm_m) / 2e-5 - claimed
    assert np.linalg.norm(off) < 0.15 * np.linalg.norm(claimed)


WRONG = np.array([-0.2, 0.04, 0.0, 0.0, 0.0, 0.0, 0.02])


def recorded(sightings: Sightings, wrong: np.ndarray) -> Sightings:
    """As a rig gives them that needs the corrections `wrong`."""
    turn = Rotation.from_rotvec(wrong[ROTATION]).inv()
    return dataclasses.replace(
        sightings,
        stamp_s=sightings.stamp_s - wrong[TIME],
        t_body_marker_m=turn.apply(sightings.t_body_marker_m - wrong[ARM]),
    )


def test_the_survey_alone_points_the_right_way(passing):
    trajectory, sightings, visits, survey = passing
    wrong = WRONG * (np.arange(N_CORRECTIONS) == TIME)
    problem = problem_of(trajectory, recorded(sightings, wrong), visits, survey, ORIGIN_ENH_M, Settings(), LEARN, PRIOR)
    prior = Between(jnp.zeros(N_CORRECTIONS), jnp.asarray(np.diag(PRIOR.sigma)))
    step = problem.asked_between(np.zeros(N_CORRECTIONS), 0.1, prior, None, None)
    mean, sigma = np.asarray(step.mean), np.sqrt(np.diag(step.covariance))
    assert sigma[TIME] < 0.7 * PRIOR.sigma[TIME]
    assert np.all(np.abs(mean - wrong) < 3.0 * sigma)
    assert mean[TIME] < -2.0 * sigma[TIME]


def test_a_passing_rig_finds_its_clock(passing):
    trajectory, sightings, visits, survey = passing
    wrong = WRONG
    found = estimated(trajectory, recorded(sightings, wrong), visits, survey)
    assert found.sigma[TIME] < 0.008
    assert abs(found.value[TIME] - wrong[TIME]) < 0.02
    assert np.all(np.abs(found.value - wrong) < 3.0 * found.sigma)
    assert np.all(found.sigma <= PRIOR.sigma)
    assert found.rival_s is None or found.rival_odds < 1.0
    rows = {row.name: row for row in corrections_of(found).rows}
    assert rows["time_offset_s"].observable != "no"
    # The rig never tilts: what a vertical arm does, the frame's height does too.
    assert rows["lever_arm_z_m"].observable == "no"
    assert "pointed the same way" in rows["lever_arm_z_m"].sentence


def test_the_held_out_location_is_kept_from_its_fold(passing, monkeypatch):
    trajectory, sightings, visits, survey = passing
    asked = []
    estimate = CorrectionEstimate(
        np.zeros(7), np.eye(7), PRIOR.sigma, np.eye(7), np.eye(7), None, 0.0, 1, 1, 1, Motion(1, 1, 1, 1, (1, 1, 1))
    )

    def record(_trajectory, _sightings, train, _survey, **_kwargs):
        asked.append({visit.location for visit in train})
        return estimate

    monkeypatch.setattr(folds, "estimate_corrections", record)
    monkeypatch.setattr(
        folds,
        "_predicted",
        lambda _t, anchors, held_out, *_: (
            anchors.surveyed_enh_m + (np.array(anchors.location) == held_out)[:, None],
            np.tile(np.eye(3), (len(anchors), 1, 1)),
            held_out != "C",
        ),
    )
    found = folds.hold_out_with_corrections(
        trajectory,
        sightings,
        visits,
        survey,
        origin_enh_m=ORIGIN_ENH_M,
        settings=Settings(),
        learn=LEARN,
        prior=PRIOR,
    )
    everywhere = {visit.location for visit in visits}
    assert asked == [everywhere - {name} for name in dict.fromkeys(visit.location for visit in visits)]
    assert found.label == tuple(visit.label for visit in visits)
    at_c = np.array(found.location) == "C"
    assert_allclose(found.error_m[~at_c], 1.0)
    assert np.all(np.isnan(found.error_m[at_c]))
    assert not found.settled[at_c].any()


def made(sigma: np.ndarray, **changes) -> CorrectionEstimate:
    value = np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motion = Motion(0.1, 0.05, 0.12, 0.03, (0.9, 0.9, 0.05))
    found = CorrectionEstimate(
        value, np.diag(sigma**2), PRIOR.sigma, np.eye(7), np.eye(7), None, 0.0, 5, 7, 300, motion
    )
    return dataclasses.replace(found, **changes)


def test_words_say_what_is_observable_and_what_motion_is_missing():
    sigma = PRIOR.sigma * [0.01, 0.3, 0.9, 0.9, 0.3, 0.9, 0.9]
    rows = corrections_of(made(sigma)).rows
    assert tuple(row.name for row in rows) == CORRECTIONS
    assert [row.observable for row in rows] == ["yes", "weakly", "no", "no", "weakly", "no", "no"]
    assert "+200.0 ms (standard deviation 1.0, before 100); it differs from zero" in rows[0].sentence
    assert "tilting the rig" in rows[3].sentence
    assert "several headings" in rows[2].sentence
    slow = corrections_of(made(PRIOR.sigma)).rows[0]
    assert slow.observable == "no"
    assert "0.10 m/s" in slow.sentence
    assert "passing markers briskly" in slow.sentence


def test_a_rival_offset_leaves_the_clock_open():
    sigma = 0.01 * PRIOR.sigma
    open_clock = corrections_of(made(sigma, rival_s=-0.15, rival_odds=0.4))
    assert open_clock.rows[0].observable == "no"
    assert open_clock.rival_s == -0.15
    assert "-150 ms fits nearly as well (odds 0.40)" in open_clock.rows[0].sentence
    assert corrections_of(made(sigma, rival_s=-0.15, rival_odds=0.01)).rows[0].observable == "yes"


def test_inseparable_corrections_are_named():
    covariance = np.diag((0.3 * PRIOR.sigma) ** 2)
    covariance[0, 1] = covariance[1, 0] = 0.95 * 0.3**2 * PRIOR.sigma[0] * PRIOR.sigma[1]
    rows = corrections_of(made(PRIOR.sigma, covariance=covariance)).rows
    assert "together with lever arm x (correlation +0.95)" in rows[0].sentence
    assert "together with time offset (correlation +0.95)" in rows[1].sentence


def test_only_what_was_estimated_has_a_row():
    found = made(PRIOR.sigma, prior_sigma=np.array([0.1, 0, 0, 0, 0, 0, 0]))
    assert [row.name for row in corrections_of(found).rows] == ["time_offset_s"]
