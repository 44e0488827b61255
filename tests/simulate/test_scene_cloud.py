"""The scene's clouds: carried with the truth they lie on the scene, with another trajectory they go with it."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError
from jaxgeo.simulate import UAV, UGV, Drift, simulate_session
from jaxgeo.simulate.cloud import RANGE_M, RANGE_SIGMA_M, cloud_of, ground_height_m, scene_points_m, see_scene
from jaxgeo.simulate.layout import SURVEYED_ENH_M


@pytest.fixture(scope="module")
def scene():
    return scene_points_m(4)


@pytest.fixture(scope="module")
def sessions():
    return [simulate_session(4, layout, drift={"icp": Drift()}) for layout in (UAV, UGV)]


def test_the_cloud_carried_with_the_truth_is_the_scene(scene, sessions):
    for session in sessions:
        seen = see_scene(session)
        assert 15_000 < len(seen) < 25_000
        cloud_m = cloud_of(session.truth, seen)
        error_m = cloud_m - scene[seen.scene_index]
        ray = cloud_m - session.truth.position_m[seen.pose_index]
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        along_m = np.sum(error_m * ray, axis=1)
        np.testing.assert_allclose(np.std(along_m), RANGE_SIGMA_M, rtol=0.05)
        assert np.abs(error_m - along_m[:, None] * ray).max() < 1e-9


def test_the_first_sighting_of_a_point_in_reach_is_by_the_nearest_pose(scene, sessions):
    session = sessions[0]
    seen = see_scene(session, range_sigma_m=0.0)
    distance_m, _ = KDTree(session.truth.position_m).query(scene)
    nearest_m = np.full(len(scene), np.inf)
    np.minimum.at(nearest_m, seen.scene_index, np.linalg.norm(seen.point_body_m, axis=1))
    inside = distance_m < RANGE_M
    np.testing.assert_allclose(nearest_m[inside], distance_m[inside], rtol=1e-9)
    assert np.all(np.isinf(nearest_m[~inside]))


def test_revisited_places_are_seen_again(sessions):
    """Around A, where the walk begins and ends, a point is seen early and late."""
    session = sessions[0]
    seen = see_scene(session)
    near = np.linalg.norm(cloud_of(session.truth, seen)[:, :2] - session.marker_enh_m["A"][:2], axis=1) < 5.0
    late = seen.pose_index > len(session.truth) / 2
    early_points, late_points = (set(seen.scene_index[near & part].tolist()) for part in (~late, late))
    assert len(early_points & late_points) > 0.8 * len(early_points | late_points)


def test_both_sessions_see_one_scene(sessions):
    uav, ugv = (set(see_scene(session).scene_index.tolist()) for session in sessions)
    assert len(uav & ugv) > 0.8 * len(uav | ugv)


def test_a_moved_trajectory_moves_its_cloud(sessions):
    session = sessions[1]
    motion = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.1, -0.2, 1.0]))
    attitude = Rotation.from_quat(session.truth.quat_wxyz, scalar_first=True)
    moved = Trajectory(
        session.truth.stamp_s,
        motion.apply(session.truth.position_m),
        (motion.rotation * attitude).as_quat(scalar_first=True),
    )
    seen = see_scene(session)
    np.testing.assert_allclose(cloud_of(moved, seen), motion.apply(cloud_of(session.truth, seen)), atol=1e-9)


def test_a_seed_is_a_scene(scene):
    np.testing.assert_array_equal(scene_points_m(4), scene)
    assert not np.array_equal(scene_points_m(5), scene)


def test_the_ground_passes_near_the_surveyed_locations():
    ground_m = ground_height_m(SURVEYED_ENH_M[:, :2])
    assert np.abs(ground_m - SURVEYED_ENH_M[:, 2]).max() < 1.0


def test_range_noise_has_its_own_stream(sessions):
    session = sessions[0]
    noisy, exact = see_scene(session), see_scene(session, range_sigma_m=0.0)
    np.testing.assert_array_equal(noisy.pose_index, exact.pose_index)
    again = see_scene(dataclasses.replace(session, sightings=sessions[1].sightings))
    np.testing.assert_array_equal(again.point_body_m, noisy.point_body_m)


def test_refusals(sessions):
    session = sessions[0]
    with pytest.raises(InputError, match="no point of the scene lies within 15 m"):
        see_scene(session, np.array([[1e4, 0.0, 0.0]]))
    short = Trajectory(*(x[:100] for x in (session.truth.stamp_s, session.truth.position_m, session.truth.quat_wxyz)))
    with pytest.raises(InputError, match="the trajectory has 100"):
        cloud_of(short, see_scene(session))
