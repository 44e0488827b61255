"""The motion between two frames of a room: right where they show one place, refused where they do not."""

import dataclasses

import numpy as np
import pytest
from rgbd_room import body_pose, looking, photograph, pinhole, walls
from scipy.optimize import approx_fprime

from jaxgeo.geometry import rigid
from jaxgeo.mapping.depth_gates import DepthGates
from jaxgeo.mapping.image_features import SiftFeatures
from jaxgeo.mapping.rgbd_alignment import AlignmentSettings, align_keyframes
from jaxgeo.mapping.rgbd_keyframe import make_keyframe
from jaxgeo.mapping.rgbd_overlap import surface_share
from jaxgeo.mapping.rgbd_refinement import FeaturePairs, _linearise, refine_motion

METHOD = SiftFeatures()
CAMERA = pinhole((0.4, -0.2, 0.3), (0.4, -1.1, 0.3))
WALLS = walls(0)


def seen_from(T_map_cam, textures=WALLS, seed=0, camera=CAMERA):
    return make_keyframe(photograph(textures, T_map_cam, camera, noise_m=0.002, seed=seed), camera, METHOD)


def align(first, second, settings=None, camera=CAMERA):
    return align_keyframes(first, second, METHOD.match(first.features, second.features), camera, settings)


POSES = [looking((0.12 * k - 0.5, 0.05 * k, 0.02 * k), 0.1 * k, 0.05 * k) for k in range(4)]
KEYFRAMES = [seen_from(T, seed=k) for k, T in enumerate(POSES)]
BY_FEATURES = AlignmentSettings(surfaces=None)


@pytest.mark.parametrize("settings", [None, BY_FEATURES])
@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 2), (1, 3), (3, 0)])
def test_motion_and_its_covariance(first, second, settings):
    found, why = align(KEYFRAMES[first], KEYFRAMES[second], settings)
    assert found is not None, why
    bodies = [body_pose(POSES[row], CAMERA) for row in (first, second)]
    off = rigid.log(rigid.inverse(found.T_first_second) @ rigid.inverse(bodies[0]) @ bodies[1])
    assert np.linalg.norm(off[:3]) < 0.012
    assert np.linalg.norm(off[3:]) < np.deg2rad(0.3)
    assert off @ found.information @ off < 16.8  # 99 % of chi2 of six
    np.testing.assert_allclose(found.information, found.information.T)
    sigma = np.sqrt(np.diag(np.linalg.inv(found.information)))
    assert sigma.max() < 0.05
    assert found.overlap > 0.95
    assert found.share > 0.8


def test_a_single_wall_is_not_slid_along():
    """Surfaces say nothing along a wall: the features' motion must stand."""
    poses = [looking((0.4, y, 0.0), 0.0) for y in (0.0, 0.3)]
    first, second = (seen_from(T, seed=k) for k, T in enumerate(poses))
    found, why = align(first, second)
    assert found is not None, why
    bodies = [body_pose(T, CAMERA) for T in poses]
    off = rigid.log(rigid.inverse(found.T_first_second) @ rigid.inverse(bodies[0]) @ bodies[1])
    assert np.linalg.norm(off[:3]) < 0.006


def test_another_room_and_a_mirrored_one_are_refused():
    other = [seen_from(T, walls(7)) for T in POSES[:2]]
    frame = photograph(WALLS, POSES[0], CAMERA)
    mirrored = dataclasses.replace(
        frame, image=np.ascontiguousarray(frame.image[:, ::-1]), depth_m=np.ascontiguousarray(frame.depth_m[:, ::-1])
    )
    for one in (*other, make_keyframe(mirrored, CAMERA, METHOD)):
        assert align(KEYFRAMES[0], one)[0] is None


def test_a_picture_hung_elsewhere_is_refused_by_the_surfaces():
    """The same wall in both frames, but what is beside it is not: the second saw through the first's surfaces."""
    near = dataclasses.replace(KEYFRAMES[1], coarse_depth_m=KEYFRAMES[1].coarse_depth_m.copy())
    near.coarse_depth_m[:, :25] += 1.0
    found, why = align(KEYFRAMES[0], near)
    assert found is None
    assert why == "surfaces contradict each other"


def test_features_in_a_corner_of_the_image_do_not_suffice():
    matches = METHOD.match(KEYFRAMES[0].features, KEYFRAMES[1].features)
    points = KEYFRAMES[0].features.points_px[matches[:, 0]]
    corner = matches[np.argsort(np.linalg.norm(points - [60.0, 60.0], axis=1))[:25]]
    assert align_keyframes(KEYFRAMES[0], KEYFRAMES[1], corner, CAMERA)[0] is not None
    found, why = align_keyframes(KEYFRAMES[0], KEYFRAMES[1], corner, CAMERA, AlignmentSettings(min_hull=0.2))
    assert found is None
    assert why == "features agree in a corner of the image only"


def test_too_few_features_do_not_suffice():
    found, why = align_keyframes(KEYFRAMES[0], KEYFRAMES[1], np.zeros((0, 2), dtype=np.int64), CAMERA)
    assert found is None
    assert why == "too few paired features"


def test_surfaces_agree_at_the_true_motion_only():
    T = rigid.inverse(body_pose(POSES[1], CAMERA)) @ body_pose(POSES[0], CAMERA)
    gates = DepthGates()
    assert surface_share(KEYFRAMES[0].points_m, KEYFRAMES[1], T, CAMERA, gates) > 0.98
    back = CAMERA.T_body_cam @ rigid.exp(np.array([0.0, 0.0, -0.5, 0.0, 0.0, 0.0])) @ rigid.inverse(CAMERA.T_body_cam)
    assert surface_share(KEYFRAMES[0].points_m, KEYFRAMES[1], back @ T, CAMERA, gates) < 0.3
    away = CAMERA.T_body_cam @ rigid.exp(np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0])) @ rigid.inverse(CAMERA.T_body_cam)
    assert surface_share(KEYFRAMES[0].points_m, KEYFRAMES[1], away @ T, CAMERA, gates) == 0.0


def noisy_pairs(seed, n=60, sigma_rad=0.002, gates=DepthGates()):  # noqa: B008 (it is frozen)
    """Features of points in front of two cameras, with the noise that the least squares suppose."""
    random = np.random.default_rng(seed)
    T = rigid.exp(np.array([0.2, -0.1, 0.15, 0.1, -0.2, 0.15]))
    second = random.uniform([-1.0, -0.8, 1.5], [1.0, 0.8, 3.5], (n, 3))
    rays, depth = [], []
    for points in (rigid.apply(T, second), second):
        rays.append(points[:, :2] / points[:, 2:] + sigma_rad * random.normal(size=(n, 2)))
        depth.append(points[:, 2] + gates.sigma_m(points[:, 2]) * random.normal(size=n))
    depth[0][::4] = np.nan
    depth[1][1::4] = np.nan
    return FeaturePairs((rays[0], rays[1]), (depth[0], depth[1])), T


def test_the_derivative_is_that_of_the_residuals():
    pairs, T = noisy_pairs(0, 8)
    agree = np.ones(8, dtype=bool)

    def residuals(x):
        return _linearise(pairs, agree, T @ rigid.exp(x), 0.002, DepthGates())[0]

    jacobian = _linearise(pairs, agree, T, 0.002, DepthGates())[1]
    np.testing.assert_allclose(jacobian, approx_fprime(np.zeros(6), residuals, 1e-7), rtol=1e-3, atol=0.5)


def test_errors_scatter_no_wider_than_the_covariance_says():
    nees = []
    for seed in range(60):
        pairs, T = noisy_pairs(seed)
        start = T @ rigid.exp(np.array([0.05, 0.0, -0.05, 0.02, 0.0, 0.02]))
        found, covariance = refine_motion(pairs, np.ones(60, dtype=bool), start, 0.002, DepthGates())
        off = rigid.log(rigid.inverse(found) @ T)
        nees.append(off @ np.linalg.solve(covariance, off))
    assert 2.0 < np.mean(nees) < 6.9  # 6 expected; less, since the halving is cautious
