"""The simulated session: the study's layout, errors of the size asked for, and files that hold it all."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.config import load_config
from jaxgeo.io.sightings_csv import read_pose_sightings
from jaxgeo.io.survey_csv import read_survey
from jaxgeo.io.tum import read_tum
from jaxgeo.simulate import Drift, simulate_session, write_session_files
from jaxgeo.simulate.drift import drifting_steps
from jaxgeo.simulate.session import COUNTS, ORDER, ORIGIN_ENH_M, REPEATABILITY_M


@pytest.fixture(scope="module")
def session():
    return simulate_session(3)


def arrays(session):
    trajectories = [session.truth, *session.trajectories.values()]
    values = [a for t in trajectories for a in (t.stamp_s, t.position_m, t.quat_wxyz)]
    s = session.sightings
    return [
        *values,
        s.stamp_s,
        s.t_body_marker_m,
        s.quat_body_marker_wxyz,
        s.covariance,
        *session.marker_enh_m.values(),
    ]


def poses(trajectory):
    rotation = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    return RigidTransform.from_components(trajectory.position_m, rotation)


def seen_at_m(session, trajectory):
    """Sightings composed with the nearest pose of a trajectory: marker positions in its map."""
    at = np.abs(trajectory.stamp_s[:, None] - session.sightings.stamp_s).argmin(axis=0)
    return poses(trajectory)[at].apply(session.sightings.t_body_marker_m)


def test_a_seed_is_a_session_bit_for_bit(session):
    again, other = simulate_session(3), simulate_session(4)
    assert all(np.array_equal(a, b) for a, b in zip(arrays(session), arrays(again), strict=True))
    assert not np.array_equal(session.sightings.t_body_marker_m, other.sightings.t_body_marker_m)
    assert not np.array_equal(session.trajectories["icp"].position_m, other.trajectories["icp"].position_m)


def test_errors_draw_from_streams_of_their_own(session):
    quieter = simulate_session(3, drift={"icp": Drift()}, visit_sigma_m=0.0)
    assert np.array_equal(quieter.truth.position_m, session.truth.position_m)
    assert np.array_equal(quieter.sightings.stamp_s, session.sightings.stamp_s)


def test_the_walk_is_one_that_a_person_can_make(session):
    truth = session.truth
    step_s = np.diff(truth.stamp_s)
    speed = np.linalg.norm(np.diff(truth.position_m, axis=0), axis=1) / step_s
    rotation = poses(truth).rotation
    turn = (rotation[:-1].inv() * rotation[1:]).magnitude() / step_s
    assert len(truth) == 1829
    np.testing.assert_allclose(step_s.sum(), 320.0)
    assert speed.max() < 1.5
    assert 0.8 < np.median(speed[speed > 0.3]) < 1.2
    assert turn.max() < 1.0


def test_layout_is_the_studys(session):
    cuts = np.flatnonzero(np.diff(session.sightings.stamp_s) > 5.0) + 1
    visits = np.split(np.arange(len(session.sightings)), cuts)
    assert tuple(map(len, visits)) == COUNTS
    composed = seen_at_m(session, session.truth)
    for location, rows, scatter_m in zip(ORDER, visits, REPEATABILITY_M, strict=True):
        centre = composed[rows].mean(axis=0)
        assert np.linalg.norm(centre - session.marker_enh_m[location]) < 0.2
        rms = np.sqrt(np.mean(np.sum((composed[rows] - centre) ** 2, axis=1)))
        np.testing.assert_allclose(rms, scatter_m, rtol=0.15)
    assert np.all(session.sightings.t_body_marker_m[:, 0] > 1.0), "the marker is ahead of the rig"


def test_without_noise_the_sightings_meet_the_markers():
    session = simulate_session(1, drift={"icp": Drift()}, survey_sigma_m=0.0, visit_sigma_m=0.0, sighting_noise=0.0)
    composed = seen_at_m(session, session.truth)
    marker = np.repeat([session.marker_enh_m[name] for name in ORDER], COUNTS, axis=0)
    # The nearest pose is up to 0.09 s away: what is left is what the rig moved in that time.
    assert np.abs(composed - marker).max() < 0.08
    surveyed = dict(zip(session.survey.name, session.survey.enh_m - ORIGIN_ENH_M, strict=True))
    assert all(np.array_equal(surveyed[name], session.marker_enh_m[name]) for name in surveyed)
    # The marker's z axis points at the rig, its y axis up.
    attitude = Rotation.from_quat(session.sightings.quat_body_marker_wxyz, scalar_first=True)
    assert np.all(attitude.apply([0.0, 0.0, 1.0])[:, 0] < -0.7)
    assert np.all(attitude.apply([0.0, 1.0, 0.0])[:, 2] > 0.9)


def test_without_drift_the_odometry_is_the_truth():
    session = simulate_session(1, drift={"icp": Drift()})
    truth, icp = poses(session.truth), poses(session.trajectories["icp"])
    np.testing.assert_allclose((truth[0] * icp).as_matrix(), truth.as_matrix(), atol=1e-10)


def test_log_scale_shrinks_the_steps():
    session = simulate_session(1, drift={"mono": Drift(log_scale=0.2)})
    truth, mono = session.truth.position_m, session.trajectories["mono"].position_m
    ratio = np.linalg.norm(truth[900] - truth[0]) / np.linalg.norm(mono[900] - mono[0])
    np.testing.assert_allclose(np.log(ratio), 0.2, rtol=1e-9)


def test_white_noise_and_bias_have_the_size_asked_for():
    """Log(O^-1 T_k^-1 T_{k+1}), scaled by length and turn, is the noise and the bias put in."""
    rng = np.random.default_rng(0)
    n, turn_rad = 20_000, 0.3
    length_m = rng.uniform(0.05, 0.5, n)
    step = RigidTransform.from_components(
        length_m[:, None] * [1.0, 0.0, 0.0], Rotation.from_rotvec(np.tile([0.0, 0.0, turn_rad], (n, 1)))
    )
    matrices = np.empty((n + 1, 4, 4))
    matrices[0] = np.eye(4)
    for k, one in enumerate(step.as_matrix()):
        matrices[k + 1] = matrices[k] @ one
    drift = Drift(
        sigma_trans_m_per_sqrt_m=(0.01, 0.02, 0.03),
        sigma_rot_rad_per_sqrt_m=(0.002, 0.003, 0.004),
        sigma_turn_rad_per_sqrt_rad=0.001,
        bias_trans_m_per_m=(0.01, 0.0, -0.02),
        bias_rot_rad_per_m=(0.0, 0.005, 0.0),
    )
    missed = (drifting_steps(RigidTransform.from_matrix(matrices), drift, rng).inv() * step).as_exp_coords()
    rot, trans = missed[:, :3], missed[:, 3:]
    trans -= length_m[:, None] * drift.bias_trans_m_per_m
    rot -= length_m[:, None] * drift.bias_rot_rad_per_m
    # Means of n draws, in standard deviations: the bias was all there was.
    for noise in (trans, rot):
        assert np.all(np.abs(noise.mean(axis=0)) < 4 * noise.std(axis=0) / np.sqrt(n))
    white = np.mean(trans**2, axis=0) / length_m.mean()
    np.testing.assert_allclose(white, np.square(drift.sigma_trans_m_per_sqrt_m), rtol=0.05)
    white = (np.mean(rot**2, axis=0) - drift.sigma_turn_rad_per_sqrt_rad**2 * turn_rad) / length_m.mean()
    np.testing.assert_allclose(white, np.square(drift.sigma_rot_rad_per_sqrt_m), rtol=0.05)


def test_icp_drifts_more_than_dense_and_both_by_metres(session):
    truth = session.truth.position_m
    revisit_m = {}
    for name, trajectory in session.trajectories.items():
        first, *_, last = np.split(seen_at_m(session, trajectory), np.cumsum(COUNTS)[:-1])
        revisit_m[name] = np.linalg.norm(first.mean(axis=0) - last.mean(axis=0))
        np.testing.assert_array_equal(trajectory.position_m[0], 0.0)
    assert 0.3 < revisit_m["dense"] < 0.6 * revisit_m["icp"]
    assert revisit_m["icp"] > 2.0
    assert np.ptp(truth, axis=0).max() < 100.0


def test_files_hold_the_session(session, tmp_path):
    path = write_session_files(session, tmp_path / "made" / "session")
    config = load_config(path)
    assert config.simulated
    assert config.seed == 3
    assert config.visits.order == list(ORDER)
    assert config.origin_enh_m == tuple(ORIGIN_ENH_M)
    assert {file.name for file in path.parent.iterdir()} == {
        *("config.yaml", "survey.csv", "sightings.csv", "icp.tum", "dense.tum", "truth.tum")
    }
    survey = read_survey(config.survey.file, crs=config.crs)
    assert survey.name == session.survey.name
    np.testing.assert_array_equal(survey.enh_m, session.survey.enh_m)
    np.testing.assert_array_equal(survey.sigma_m, session.survey.sigma_m)
    for name, given in config.trajectories.items():
        np.testing.assert_array_equal(read_tum(given.file).position_m, session.trajectories[name].position_m)
        np.testing.assert_array_equal(read_tum(given.reference.file).position_m, session.truth.position_m)
    sightings = read_pose_sightings(config.sightings.file)
    np.testing.assert_array_equal(sightings.t_body_marker_m, session.sightings.t_body_marker_m)
    np.testing.assert_array_equal(sightings.covariance, session.sightings.covariance)


def test_the_seed_makes_the_same_files(session, tmp_path):
    one, two = (write_session_files(simulate_session(3), tmp_path / name).parent for name in "ab")
    for file in one.iterdir():
        assert file.read_bytes() == (two / file.name).read_bytes()


def test_a_session_cannot_be_changed(session):
    with pytest.raises(dataclasses.FrozenInstanceError):
        session.seed = 1
