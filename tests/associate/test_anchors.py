import dataclasses

import numpy as np
import pytest
import tagslam_session
from hypothesis import given, settings
from hypothesis import strategies as st
from marker_scene import point_sightings
from scipy.spatial.transform import Rotation

from jaxgeo.associate.anchors import make_anchors
from jaxgeo.associate.centroid import CentroidRule
from jaxgeo.associate.labels import label_visits
from jaxgeo.associate.pnp import corners_to_sightings
from jaxgeo.associate.visits import cut_visits
from jaxgeo.data import Sightings, Survey, Trajectory
from jaxgeo.errors import SightingError

TURN_RAD_S, PACE_M_S = np.array([0.1, 0.05, 0.2]), np.array([0.5, 0.1, 0.02])
ORIGIN = np.array([79000.0, 76000.0, 300.0])
MARKERS_M = {"A": np.array([1.0, 2.0, 0.5]), "B": np.array([-1.0, 3.0, 1.0])}


def _pose(stamp_s: float) -> np.ndarray:
    """Exp(t (pace, turn)), a screw motion: what interpolation between its poses gives exactly."""
    speed = np.linalg.norm(TURN_RAD_S)
    x, y, z = TURN_RAD_S / speed
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = speed * stamp_s
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * hat + (1.0 - np.cos(angle)) * hat @ hat
    path = angle * np.eye(3) + (1.0 - np.cos(angle)) * hat + (angle - np.sin(angle)) * hat @ hat
    pose[:3, 3] = path @ PACE_M_S / speed
    return pose


def _trajectory(stamps_s) -> Trajectory:
    poses = np.array([_pose(t) for t in stamps_s])
    quat = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
    return Trajectory(np.asarray(stamps_s, dtype=np.float64), poses[:, :3, 3], quat)


def _survey(rotation: Rotation | None = None, sigma_rot_rad: float = 0.02) -> Survey:
    n = len(MARKERS_M)
    quat = np.full((n, 4), np.nan) if rotation is None else np.tile(rotation.as_quat(scalar_first=True), (n, 1))
    return Survey(
        name=tuple(MARKERS_M),
        enh_m=np.array(list(MARKERS_M.values())) + ORIGIN,
        sigma_m=np.tile([0.01, 0.02, 0.03], (n, 1)),
        quat_grid_marker_wxyz=quat,
        sigma_rot_rad=np.full((n, 3), np.nan if rotation is None else sigma_rot_rad),
        crs="local",
    )


def _sightings(stamps_s, markers, sigma_m=0.01) -> Sightings:
    """Exact sightings of the markers from the screw motion."""
    seen = [(np.linalg.inv(_pose(t)) @ [*MARKERS_M[m], 1.0])[:3] for t, m in zip(stamps_s, markers, strict=True)]
    return point_sightings(np.asarray(stamps_s), np.array(seen), sigma_m, markers)


def _with_rotation(sightings: Sightings, R_map_marker: Rotation, noise_rad: float = 0.0, ambiguous=False) -> Sightings:
    n, rng = len(sightings), np.random.default_rng(9)
    R_map_body = Rotation.from_matrix([_pose(t)[:3, :3] for t in sightings.stamp_s])
    noise = Rotation.from_rotvec(noise_rad * rng.normal(size=(n, 3)))
    covariance = sightings.covariance.copy()
    covariance[:, 3:, 3:] = max(noise_rad, 0.01) ** 2 * np.eye(3)
    return dataclasses.replace(
        sightings,
        quat_body_marker_wxyz=(noise * R_map_body.inv() * R_map_marker).as_quat(scalar_first=True),
        covariance=covariance,
        ambiguous=np.broadcast_to(ambiguous, (n,)).copy(),
    )


def _anchors(trajectory, sightings, survey=None, gap_s=2.0, **options):
    survey = survey or _survey()
    visits, _ = label_visits(cut_visits(sightings, gap_s), survey)
    return make_anchors(trajectory, sightings, visits, survey, origin_enh_m=ORIGIN, **options)


STAMPS = np.concatenate([np.arange(3.03, 4.0, 0.07), np.arange(3.5, 4.2, 0.11), np.arange(8.01, 9.0, 0.13)])
NAMES = ["A"] * 14 + ["B"] * 7 + ["A"] * 8


def test_exact_sightings_give_the_exact_lever_arm():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    anchors, warnings = _anchors(trajectory, _sightings(STAMPS, NAMES))
    assert warnings == ()
    assert anchors.label == ("A", "B", "A_revisit")
    assert anchors.location == ("A", "B", "A")
    assert anchors.location_index.tolist() == [0, 1, 0]
    assert anchors.count.tolist() == [14, 7, 8]
    for k in range(3):
        pose = _pose(anchors.stamp_s[k])
        np.testing.assert_allclose(
            (pose @ [*anchors.lever_arm_m[k], 1.0])[:3], MARKERS_M[anchors.location[k]], atol=1e-9
        )
        np.testing.assert_array_equal(anchors.stamp_s[k], trajectory.stamp_s[anchors.pose_index[k]])
    np.testing.assert_allclose(anchors.surveyed_enh_m, [MARKERS_M[name] for name in "ABA"], atol=1e-9)
    np.testing.assert_allclose(anchors.survey_covariance_m2, np.tile(np.diag([1e-4, 4e-4, 9e-4]), (3, 1, 1)))
    np.testing.assert_allclose(anchors.repeatability_m, 0.0, atol=1e-9)
    assert np.isnan(anchors.quat_body_marker_wxyz).all()
    np.testing.assert_array_equal(anchors.rotation_covariance_rad2, 0.0)


def test_the_reference_is_the_pose_at_or_before_the_weighted_middle():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.5))
    stamps = np.array([2.1, 2.9, 3.7])
    anchors, _ = _anchors(trajectory, _sightings(stamps, ["A"] * 3))
    assert anchors.stamp_s.tolist() == [2.5]
    anchors, _ = _anchors(trajectory, _sightings(stamps, ["A"] * 3, sigma_m=np.array([0.1, 0.1, 0.01])))
    assert anchors.stamp_s.tolist() == [3.5]
    anchors, _ = _anchors(trajectory, _sightings(np.array([3.0]), ["A"]))
    assert anchors.stamp_s.tolist() == [3.0]
    anchors, _ = _anchors(trajectory, _sightings(np.array([9.5]), ["A"]))  # the very last pose
    assert anchors.pose_index.tolist() == [19]
    np.testing.assert_allclose((_pose(9.5) @ [*anchors.lever_arm_m[0], 1.0])[:3], MARKERS_M["A"], atol=1e-9)


def test_several_anchors_may_share_a_pose():
    trajectory = _trajectory(np.arange(0.0, 10.0, 1.0))
    anchors, _ = _anchors(trajectory, _sightings(np.array([3.2, 3.6]), ["B", "A"]))
    assert anchors.pose_index.tolist() == [3, 3]
    assert set(anchors.label) == {"A", "B"}


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_lever_arms_do_not_depend_on_the_map_frame(seed):
    rng = np.random.default_rng(seed)
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    sightings = _sightings(STAMPS, NAMES)
    noisy = dataclasses.replace(
        sightings, t_body_marker_m=sightings.t_body_marker_m + 0.01 * rng.normal(size=(len(sightings), 3))
    )
    turn, shift = Rotation.random(rng=rng), 100.0 * rng.normal(size=3)
    moved = Trajectory(
        trajectory.stamp_s,
        turn.apply(trajectory.position_m) + shift,
        (turn * Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)).as_quat(scalar_first=True),
    )
    here, there = (_anchors(t, noisy)[0] for t in (trajectory, moved))
    assert here.label == there.label
    np.testing.assert_allclose(here.repeatability_m, there.repeatability_m, rtol=1e-9)
    # Only the robust start (a median by coordinate) knows the axes, and reweighting forgets it.
    np.testing.assert_allclose(here.lever_arm_m, there.lever_arm_m, atol=1e-6)
    np.testing.assert_allclose(here.lever_covariance_m2, there.lever_covariance_m2, rtol=1e-3, atol=1e-9)


def test_covariance_of_one_sighting_is_its_own_in_body_axes():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    sightings = _sightings(np.array([5.0]), ["A"])
    sightings.covariance[0, :3, :3] = np.diag([1e-4, 4e-4, 16e-4])
    anchors, _ = _anchors(trajectory, sightings, rule=CentroidRule(floor_m=0.0))
    np.testing.assert_allclose(anchors.lever_covariance_m2[0], sightings.covariance[0, :3, :3], atol=1e-15)


def test_a_wild_detection_does_not_move_the_anchor():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    clean = _sightings(STAMPS, NAMES)
    noise = 0.01 * np.random.default_rng(3).normal(size=(len(clean), 3))
    clean = dataclasses.replace(clean, t_body_marker_m=clean.t_body_marker_m + noise)
    wild = dataclasses.replace(clean, t_body_marker_m=clean.t_body_marker_m.copy())
    wild.t_body_marker_m[4] += [3.0, -2.0, 5.0]
    before, after = (_anchors(trajectory, sightings)[0] for sightings in (clean, wild))
    assert np.linalg.norm(before.lever_arm_m[0] - after.lever_arm_m[0]) < 0.008
    np.testing.assert_array_equal(before.lever_arm_m[1:], after.lever_arm_m[1:])
    assert after.repeatability_m[0] > 1.0  # it is told, not hidden


def test_repeatability_is_the_rms_about_the_centroid():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    sightings = _sightings(STAMPS[:14], NAMES[:14])
    noise = 0.02 * np.random.default_rng(4).normal(size=(14, 3))
    R = np.array([_pose(t)[:3, :3] for t in sightings.stamp_s])
    noisy = dataclasses.replace(sightings, t_body_marker_m=sightings.t_body_marker_m + noise)
    anchors, _ = _anchors(trajectory, noisy)
    in_map = np.einsum("nij,nj->ni", R, noise)
    about = in_map - in_map.mean(axis=0)
    assert anchors.repeatability_m[0] == pytest.approx(np.sqrt((about**2).sum(axis=1).mean()), rel=1e-6)


def test_rotations_are_averaged_where_the_survey_has_them():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    R_map_marker, R_grid_marker = Rotation.from_rotvec([0.4, -1.0, 2.0]), Rotation.from_rotvec([1.0, 0.2, -0.3])
    sightings = _with_rotation(_sightings(STAMPS, NAMES), R_map_marker, noise_rad=0.02)
    anchors, _ = _anchors(trajectory, sightings, _survey(R_grid_marker, sigma_rot_rad=0.05))
    for k in range(3):
        R_map_body = Rotation.from_matrix(_pose(anchors.stamp_s[k])[:3, :3])
        found = R_map_body * Rotation.from_quat(anchors.quat_body_marker_wxyz[k], scalar_first=True)
        assert (found * R_map_marker.inv()).magnitude() < 0.03
        np.testing.assert_allclose(anchors.quat_grid_marker_wxyz[k], R_grid_marker.as_quat(scalar_first=True))
        sigma = np.sqrt(np.trace(anchors.rotation_covariance_rad2[k]) / 3.0)
        assert 0.05 < sigma < 0.056  # the survey's 0.05, and at most one sighting's 0.02 beside it


def test_the_mean_rotation_is_the_mean_where_nothing_is_wild():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    R_map_marker = Rotation.from_rotvec([0.4, -1.0, 2.0])
    sightings = _with_rotation(_sightings(np.array([5.0, 5.1, 5.2, 5.3]), ["A"] * 4), R_map_marker, noise_rad=0.01)
    sightings.covariance[:, 3:, 3:] *= 16.0  # every one within Huber's threshold
    anchors, _ = _anchors(trajectory, sightings, _survey(R_map_marker))
    R_map_body = Rotation.from_matrix([_pose(t)[:3, :3] for t in sightings.stamp_s])
    expected = (R_map_body * Rotation.from_quat(sightings.quat_body_marker_wxyz, scalar_first=True)).mean()
    found = _pose(anchors.stamp_s[0])[:3, :3] @ _matrix(anchors.quat_body_marker_wxyz[0])
    np.testing.assert_allclose(found, expected.as_matrix(), atol=1e-5)


def _matrix(quat_wxyz: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()


def test_surveyed_rotation_errors_are_turned_into_body_axes():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    R_map_marker, R_grid_marker = Rotation.from_rotvec([0.4, -1.0, 2.0]), Rotation.from_rotvec([1.0, 0.2, -0.3])
    survey = _survey(R_grid_marker)
    survey.sigma_rot_rad[:] = [0.5, 0.1, 0.02]
    sightings = _with_rotation(_sightings(np.array([5.0]), ["A"]), R_map_marker)
    sightings.covariance[0, 3:, 3:] = np.diag([0.01, 0.04, 0.0025])
    rule = CentroidRule(floor_rad=0.0)
    anchors, _ = _anchors(trajectory, sightings, survey, rule=rule)
    R_body_grid = (
        Rotation.from_quat(sightings.quat_body_marker_wxyz[0], scalar_first=True) * R_grid_marker.inv()
    ).as_matrix()
    expected = R_body_grid @ np.diag([0.25, 0.01, 0.0004]) @ R_body_grid.T + np.diag([0.01, 0.04, 0.0025])
    np.testing.assert_allclose(anchors.rotation_covariance_rad2[0], expected, atol=1e-12)


def test_ambiguous_sightings_give_position_only():
    trajectory = _trajectory(np.arange(0.0, 10.0, 0.1))
    R_map_marker = Rotation.from_rotvec([0.4, -1.0, 2.0])
    survey = _survey(R_map_marker)
    sightings = _with_rotation(_sightings(STAMPS, NAMES), R_map_marker, ambiguous=True)
    anchors, _ = _anchors(trajectory, sightings, survey)
    assert np.isnan(anchors.quat_body_marker_wxyz).all()
    assert np.isnan(anchors.quat_grid_marker_wxyz).all()
    np.testing.assert_array_equal(anchors.rotation_covariance_rad2, 0.0)
    # Most rotations of the first visit are wrong and marked: the two clear ones decide.
    flipped = _with_rotation(
        _sightings(STAMPS, NAMES), R_map_marker * Rotation.from_rotvec([0.8, 0.0, 0.0]), ambiguous=True
    )
    for row in (2, 9):
        flipped.quat_body_marker_wxyz[row] = sightings.quat_body_marker_wxyz[row]
        flipped.ambiguous[row] = False
    anchors, _ = _anchors(trajectory, flipped, survey)
    found = (
        _pose(anchors.stamp_s[0])[:3, :3]
        @ Rotation.from_quat(anchors.quat_body_marker_wxyz[0], scalar_first=True).as_matrix()
    )
    np.testing.assert_allclose(found, R_map_marker.as_matrix(), atol=1e-6)
    assert np.isnan(anchors.quat_body_marker_wxyz[1:]).all()


def test_a_few_sightings_outside_the_trajectory_are_left_out_with_a_warning():
    stamps = np.concatenate([np.arange(2.0, 6.0, 0.1), [9.95]])
    sightings = _sightings(stamps, ["A"] * 40 + ["B"])
    anchors, warnings = _anchors(_trajectory(np.arange(0.0, 9.05, 0.1)), sightings)
    assert anchors.label == ("A",)
    assert anchors.count.tolist() == [40]
    assert len(warnings) == 1
    assert "1 of 41 sightings lie outside the trajectory's time, the first at 9.950 s (sightings.csv:42)" in warnings[0]
    assert "runs from 0.000 to 9.000 s" in warnings[0]
    assert "left out, and with them the whole of visit B" in warnings[0]
    trimmed, _ = _anchors(_trajectory(np.arange(2.05, 9.05, 0.1)), sightings.take(np.arange(40)))
    assert trimmed.count.tolist() == [39]


def test_many_sightings_outside_are_an_error():
    sightings = _sightings(np.arange(2.0, 6.0, 0.1), ["A"] * 40)
    with pytest.raises(SightingError, match=r"10 of 40 .*first at 2.000 s \(sightings.csv:2\).*seems cut"):
        _anchors(_trajectory(np.arange(2.95, 9.0, 0.1)), sightings)
    unix = dataclasses.replace(sightings, stamp_s=sightings.stamp_s + 1.5e9)
    with pytest.raises(SightingError, match=r"40 of 40 .*from 0.000 to 9.\d+ s, the sightings from 15.*another epoch"):
        _anchors(_trajectory(np.arange(0.0, 9.05, 0.1)), unix)


def test_sightings_in_a_pause_of_the_trajectory_are_reported():
    stamps = np.concatenate([np.arange(0.0, 3.0, 0.1), np.arange(6.0, 9.0, 0.1)])
    _, warnings = _anchors(
        _trajectory(stamps), _sightings(np.array([1.05, stamps[29], 4.0, 7.05]), ["A"] * 4), gap_s=5.0
    )
    assert len(warnings) == 1
    assert "1 of 4 sightings fall into pauses of the trajectory of up to 3.1 s, the first at 4.000 s" in warnings[0]


def test_unusable_visits_and_covariances_are_refused():
    trajectory, sightings = _trajectory(np.arange(0.0, 10.0, 0.1)), _sightings(np.array([5.0]), ["A"])
    visits = cut_visits(sightings, 1.0)
    with pytest.raises(SightingError, match=r"visit from 5.000 to 5.000 s.*label the visits first"):
        make_anchors(trajectory, sightings, visits, _survey(), origin_enh_m=ORIGIN)
    with pytest.raises(SightingError, match="no visits"):
        make_anchors(trajectory, sightings, [], _survey(), origin_enh_m=ORIGIN)
    sightings.covariance[0, 0, 0] = 0.0
    with pytest.raises(SightingError, match=r"sightings.csv:2: the position covariance.*not positive definite"):
        _anchors(trajectory, sightings)


def test_real_visits_survive_poor_odometry():
    """Through TagSLAM's VIO, drifting by up to 0.1 m/s within a visit, against lever arms from its reference poses."""
    session = tagslam_session.load(body="odom")
    sightings, _ = corners_to_sightings(session.corners, session.rig, 0.15, 0.5)
    visits, warnings = label_visits(cut_visits(sightings, 5.0), session.survey)
    assert warnings == ()
    assert len(visits) == 39
    assert len({visit.location for visit in visits}) == 20
    anchors, warnings = make_anchors(session.vio, sightings, visits, session.survey, origin_enh_m=np.zeros(3))
    assert warnings == ()
    R = Rotation.from_quat(session.reference.quat_wxyz[anchors.pose_index], scalar_first=True)
    tags = np.array([session.adjusted_tags[name] for name in anchors.location])
    truth = R.inv().apply(tags[:, :3] - session.reference.position_m[anchors.pose_index])
    error = anchors.lever_arm_m - truth
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(anchors.lever_covariance_m2), error) / 3.0
    norm = np.linalg.norm(error, axis=1)
    assert norm.mean() < 0.02  # the plain mean of each visit: 0.04, with the worst visit at 0.36
    assert norm.max() < 0.10
    assert 0.2 < nees.mean() < 2.0
    known = np.isfinite(anchors.quat_body_marker_wxyz[:, 0])
    assert known.sum() > 20
    turned = R[known] * Rotation.from_quat(anchors.quat_body_marker_wxyz[known], scalar_first=True)
    miss = (turned * Rotation.from_rotvec(tags[known, 3:]).inv()).magnitude()
    assert np.median(miss) < 0.01
