"""Leave-one-location-out: folds against plain loops, and not a bit of a held-out location in its own fold."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eval.loo
from calibration.calibrate import LearnSettings, calibrate_and_correct
from eval.loo import LeaveOneOut, correct_and_hold_out, correct_under_and_hold_out, learn_and_hold_out
from eval.revisit import revisit_gaps
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import ensemble_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.simulate import UAV, Drift, SimulatedSession, simulate_session
from jaxgeo.simulate.layout import ORDER, ORIGIN_ENH_M
from jaxgeo.solve.correct import Settings, correct
from jaxgeo.solve.fold import Fold, solve_folds


@pytest.fixture(scope="module")
def session() -> tuple[Trajectory, Anchors]:
    return anchored(simulate_session(3, SHORT))


def anchored(simulated: SimulatedSession) -> tuple[Trajectory, Anchors]:
    visits, _ = label_visits(cut_visits(simulated.sightings, 5.0), simulated.survey, order=list(ORDER))
    trajectory = simulated.trajectories["icp"]
    anchors, _ = make_anchors(trajectory, simulated.sightings, visits, simulated.survey, origin_enh_m=ORIGIN_ENH_M)
    return trajectory, anchors


NOISE = default_noise("lidar")
SETTINGS = Settings()
# The shapes of the other tests.
SHORT = dataclasses.replace(UAV, n_poses=200)


def hold_out(trajectory: Trajectory, anchors: Anchors, noise: OdometryNoise = NOISE) -> LeaveOneOut:
    return correct_and_hold_out(trajectory, anchors, noise, SETTINGS)[1]


def own_fold(trajectory: Trajectory, anchors: Anchors, location: str) -> Fold:
    """All that the fold without a location finds: coarse fit, origin, predictions, covariances, cost and result."""
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain)
    use = np.zeros((1, table.real.shape[0]))
    use[0, : len(anchors)] = [name != location for name in anchors.location]
    found, _ = solve_folds(chain, table, NOISE, jnp.asarray(use), jnp.asarray(3.0), SETTINGS.fold_options(NOISE))
    return jax.tree.map(lambda x: np.asarray(x)[0], found)


def without(anchors: Anchors, location: str) -> tuple[Anchors, np.ndarray]:
    """The anchors of all other locations, and which rows those are."""
    rows = np.array([i for i, name in enumerate(anchors.location) if name != location])
    fields = {f.name: getattr(anchors, f.name) for f in dataclasses.fields(anchors)}
    kept = {n: tuple(v[i] for i in rows) if isinstance(v, tuple) else v[rows] for n, v in fields.items()}
    kept["location_index"] = np.unique(kept["location_index"], return_inverse=True)[1]
    return Anchors(**kept), rows


def moved(anchors: Anchors, location: str, by_m: np.ndarray) -> Anchors:
    here = np.array([name == location for name in anchors.location])
    shifted = np.where(here[:, None], anchors.surveyed_enh_m + by_m, anchors.surveyed_enh_m)
    return eqx.tree_at(lambda a: a.surveyed_enh_m, anchors, shifted)


def test_every_fold_equals_a_correction_without_the_location(session):
    trajectory, anchors = session
    found = hold_out(trajectory, anchors)
    for location in dict.fromkeys(anchors.location):
        fewer, _ = without(anchors, location)
        corrected = correct(trajectory, fewer, NOISE, SETTINGS).corrected
        for i in (i for i, name in enumerate(anchors.location) if name == location):
            w, *v = corrected.quat_wxyz[anchors.pose_index[i]]
            arm, v = anchors.lever_arm_m[i], np.array(v)
            turned = arm + 2 * w * np.cross(v, arm) + 2 * np.cross(v, np.cross(v, arm))
            expected = corrected.position_m[anchors.pose_index[i]] + turned
            np.testing.assert_allclose(found.point_m[i], expected, atol=1e-6)


def test_held_out_coordinates_reach_nothing_of_their_own_fold(session):
    trajectory, anchors = session
    for location in ("A", "D"):
        here = np.array([name == location for name in anchors.location])
        by_m = np.array([100.0, -100.0, 7.3])
        fold, shifted = (
            jax.tree.leaves(own_fold(trajectory, a, location)) for a in (anchors, moved(anchors, location, by_m))
        )
        assert len(fold) == len(shifted) > 10
        for a, b in zip(fold, shifted, strict=True):
            np.testing.assert_array_equal(a, b)
        others = own_fold(trajectory, moved(anchors, anchors.location[1], 0.1 * by_m), location)
        assert (
            np.abs(
                others.point_m[: len(anchors)][here]
                - own_fold(trajectory, anchors, location).point_m[: len(anchors)][here]
            ).max()
            > 0.1
        ), "a location that is not held out must be seen"


def test_the_session_origin_reaches_no_fold(session):
    # Whole kilometres, as another default origin would differ by: predictions move with it, to the last bit but one.
    trajectory, anchors = session
    by_m = np.array([3000.0, -2000.0, 100.0])
    shifted = hold_out(trajectory, eqx.tree_at(lambda a: a.surveyed_enh_m, anchors, anchors.surveyed_enh_m + by_m))
    np.testing.assert_allclose(shifted.point_m - by_m, hold_out(trajectory, anchors).point_m, atol=1e-8)


def test_a_fold_that_is_not_determined_says_so(session):
    trajectory, anchors = session
    three, _ = without(anchors, "A")
    for location in ("B", "C", "D"):
        if len(set(three.location)) > 3:
            three, _ = without(three, location)
    found = hold_out(trajectory, three)
    assert np.isnan(found.refined.error_enh_m).all()
    assert all("undetermined" in words for words in found.refined.result)


def test_predicted_covariance_is_that_of_the_error():
    assumed = Drift(sigma_trans_m_per_sqrt_m=(0.02,) * 3, sigma_rot_rad_per_sqrt_m=(0.001,) * 3)
    trajectory, anchors = anchored(simulate_session(3, SHORT, drift={"icp": assumed}))
    found = hold_out(trajectory, anchors).refined
    nees = np.einsum("ka,kab,kb->k", found.error_enh_m, np.linalg.inv(found.covariance_m2), found.error_enh_m)
    assert 0.3 < nees.mean() / 3 < 3.0  # NEES of 7 visits, mean about 1
    loose = hold_out(trajectory, anchors, default_noise("lidar", sigma_trans_m_per_sqrt_m=0.2)).refined
    assert (np.trace(loose.covariance_m2, axis1=1, axis2=2) > np.trace(found.covariance_m2, axis1=1, axis2=2)).all()


def test_revisit_gap_is_the_largest_distance_between_visits():
    points = {"coarse_m": np.array([[0.0, 0, 0], [3, 4, 0], [9, 9, 9], [0, 0, 1]])}
    assert revisit_gaps(("A", "A", "B", "A"), points) == {"A": {"coarse_m": pytest.approx(np.sqrt(26))}}


LEARN = LearnSettings("lidar", NOISE)


@pytest.fixture(scope="module")
def learned(session):
    trajectory, anchors = session
    fixed = hold_out(trajectory, anchors)
    return fixed, learn_and_hold_out(trajectory, anchors, SETTINGS, LEARN, fixed)


def test_learned_folds_predict_what_learning_without_the_location_corrects(session, learned):
    trajectory, anchors = session
    _, (_, _, found) = learned
    here = np.array([name != "D" for name in anchors.location])
    # The fold that leaves D out, as the only one: its poses, not its prediction, say where D's marker is.
    _, correction, _ = calibrate_and_correct(
        trajectory, without(anchors, "D")[0], SETTINGS, LEARN, np.ones((1, int(here.sum())))
    )
    (row,) = np.flatnonzero(~here)
    pose, arm = anchors.pose_index[row], anchors.lever_arm_m[row]
    turned = Rotation.from_quat(correction.corrected.quat_wxyz[pose], scalar_first=True).apply(arm)
    np.testing.assert_allclose(found.point_m[row], correction.corrected.position_m[pose] + turned, atol=2e-3)
    assert found.refined.result[row] == "converged"


def test_held_out_coordinates_reach_nothing_that_is_learned_in_their_own_fold(session, learned):
    trajectory, anchors = session
    fixed, (_, _, found) = learned
    for location in ("A", "D"):
        here = np.array([name == location for name in anchors.location])
        # Not too far: the correction with all anchors, which reads it, must settle.
        spoilt = moved(anchors, location, np.array([3.0, -2.0, 0.7]))
        _, _, other = learn_and_hold_out(trajectory, spoilt, SETTINGS, LEARN, fixed)
        np.testing.assert_array_equal(other.point_m[here], found.point_m[here])
        np.testing.assert_array_equal(other.refined.covariance_m2[here], found.refined.covariance_m2[here])
        assert np.abs(other.point_m[~here] - found.point_m[~here]).max() > 0.01


def test_a_fold_that_is_not_determined_says_so_with_learned_noise_too(session):
    trajectory, anchors = session
    three = anchors
    for location in ("B", "C", "D"):
        three, _ = without(three, location)
    fixed = hold_out(trajectory, three)
    _, _, found = learn_and_hold_out(trajectory, three, SETTINGS, LEARN, fixed)
    assert np.isnan(found.refined.error_enh_m).all()
    assert np.isnan(found.refined.covariance_m2).all()
    assert found.refined.result == fixed.refined.result


def test_a_learned_fold_that_does_not_settle_gives_nothing_and_says_so(session, learned, monkeypatch):
    trajectory, anchors = session
    fixed, _ = learned

    def one_unsettled(*arguments):
        calibration, correction, folds = calibrate_and_correct(*arguments)
        settled = np.asarray(folds.fold.settled).copy()
        settled[1 + anchors.location_index[2]] = False
        return calibration, correction, eqx.tree_at(lambda f: f.fold.settled, folds, settled)

    monkeypatch.setattr(eval.loo, "calibrate_and_correct", one_unsettled)
    _, _, found = learn_and_hold_out(trajectory, anchors, SETTINGS, LEARN, fixed)
    bad = anchors.location_index == anchors.location_index[2]
    assert np.isnan(found.point_m[bad]).all()
    assert np.isfinite(found.point_m[~bad]).all()
    assert found.refined.result[2].startswith("not settled after ")


def test_a_fold_whose_noise_was_held_says_so(session, learned, monkeypatch):
    trajectory, anchors = session
    fixed, _ = learned

    def one_held(*arguments):
        calibration, correction, folds = calibrate_and_correct(*arguments)
        rounds = np.asarray(folds.fold.rounds).copy()
        rounds[1 + anchors.location_index[2]] = 14
        return calibration, correction, eqx.tree_at(lambda f: f.fold.rounds, folds, rounds)

    monkeypatch.setattr(eval.loo, "calibrate_and_correct", one_held)
    _, _, found = learn_and_hold_out(trajectory, anchors, SETTINGS, LEARN, fixed)
    here = anchors.location_index == anchors.location_index[2]
    assert np.isfinite(found.point_m[here]).all()
    assert {found.refined.result[i] for i in np.flatnonzero(here)} == {"converged, the noise held after 12 rounds"}
    assert found.refined.result[int(np.flatnonzero(~here)[0])] == "converged"


def test_a_fixed_noise_as_an_ensemble_of_one_gives_the_fixed_folds(session, learned):
    trajectory, anchors = session
    fixed, _ = learned
    correction, found = correct_under_and_hold_out(trajectory, anchors, SETTINGS, ensemble_of(NOISE), fixed)
    np.testing.assert_allclose(found.point_m, fixed.point_m, atol=1e-3)
    np.testing.assert_allclose(found.refined.covariance_m2, fixed.refined.covariance_m2, rtol=0.02, atol=1e-6)
    expected = correct_and_hold_out(trajectory, anchors, NOISE, SETTINGS)[0]
    # Millimetres at the end of the path, far from any marker: settled means that no marker moves.
    np.testing.assert_allclose(correction.corrected.position_m, expected.corrected.position_m, atol=0.01)
