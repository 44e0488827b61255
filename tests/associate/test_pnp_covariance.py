"""Corners with covariances of their own: what is minimised, and whether the pose covariance is honest."""

import dataclasses

import numpy as np
import pytest
from marker_scene import BODY_CAM, camera, corner_sightings, corners_of, facing, rig
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxgeo.associate.ambiguity import AmbiguityRule
from jaxgeo.associate.pnp import corners_to_sightings
from jaxgeo.errors import SightingError

SIDE_M = 0.15
ALONE = AmbiguityRule()


def _correlated(rng, sigma_px, n):
    """(n, 8, 8) covariances, each another, with correlations up to about a half."""
    factor = rng.normal(size=(n, 8, 8))
    return np.reshape(sigma_px, (-1, 1, 1)) ** 2 * (0.5 * np.eye(8) + 0.5 * factor @ factor.mT / 8.0)


def _scene(rng, size_px, tilt_rad, sigma_px, covariance=None):
    """Noisy corners of one marker each, with their covariance, and the true poses in the body."""
    n = len(size_px)
    turned = Rotation.from_rotvec(np.outer(rng.uniform(-np.pi, np.pi, n), [0.0, 0.0, 1.0])).as_matrix()
    R = np.stack([facing(tilt, about) for tilt, about in zip(tilt_rad, rng.uniform(-np.pi, np.pi, n), strict=True)])
    R = R @ turned
    t = (SIDE_M * 600.0 / size_px)[:, None] * np.column_stack([rng.uniform(-0.4, 0.4, (n, 2)), np.ones(n)])
    covariance = _correlated(rng, sigma_px, n) if covariance is None else covariance
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(n, 8)))
    pixels = corners_of(R, t, SIDE_M, camera("radtan")) + noise.reshape(n, 4, 2)
    corners = dataclasses.replace(
        corner_sightings(pixels), marker=np.array([str(i) for i in range(n)]), covariance_px2=covariance
    )
    return corners, Rotation.from_matrix(BODY_CAM.as_matrix() @ R), BODY_CAM.apply(t) + camera().t_body_cam_m


def _nees(sightings, rotation, position):
    row = sightings.marker.astype(int)
    turned = Rotation.from_quat(sightings.quat_body_marker_wxyz, scalar_first=True) * rotation[row].inv()
    error = np.column_stack([sightings.t_body_marker_m - position[row], turned.as_rotvec()])
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(sightings.covariance), error)


def test_pose_and_covariance_equal_scipys_weighted_least_squares():
    corners, rotation, position = _scene(np.random.default_rng(0), np.full(4, 80.0), np.full(4, 0.8), 0.3)
    sightings, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 1.0)
    assert corners.covariance_px2 is not None
    for i in range(4):
        white = np.linalg.inv(np.linalg.cholesky(corners.covariance_px2[i]))

        def residual(x, i=i, white=white):
            R, t = Rotation.from_rotvec(x[3:]) * rotation[i], x[:3] + position[i]
            cam_R, cam_t = BODY_CAM.inv() * R, BODY_CAM.inv().apply(t - camera().t_body_cam_m)
            seen = corners_of(cam_R.as_matrix(), cam_t, SIDE_M, camera("radtan"))
            return white @ (seen - corners.corners_px[i]).ravel()

        best = least_squares(residual, np.zeros(6), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        sigma = np.sqrt(np.diag(sightings.covariance[i]))
        turned = Rotation.from_quat(sightings.quat_body_marker_wxyz[i], scalar_first=True) * rotation[i].inv()
        found = np.concatenate([sightings.t_body_marker_m[i] - position[i], turned.as_rotvec()])
        np.testing.assert_allclose((found - best.x) / sigma, 0.0, atol=1e-3)
        spread = np.linalg.inv(best.jac.T @ best.jac)
        # SciPy's tangent is at the truth, ours at the estimate: they differ by the error of the rotation.
        unit = np.outer(sigma, sigma)
        np.testing.assert_allclose(sightings.covariance[i] / unit, spread / unit, atol=0.05)


def test_one_sigma_as_covariance_is_that_sigma():
    corners, _, _ = _scene(np.random.default_rng(1), np.full(50, 80.0), np.full(50, 0.6), 0.3)
    plain = dataclasses.replace(corners, covariance_px2=None)
    covariance = np.repeat(0.3**2 * np.eye(8)[None], 50, axis=0)
    same = dataclasses.replace(corners, covariance_px2=covariance.copy())
    covariance[1::2] = np.nan
    some = dataclasses.replace(corners, covariance_px2=covariance)
    expected, _ = corners_to_sightings(plain, rig("radtan"), SIDE_M, 0.3)
    for given in (same, some):
        found, _ = corners_to_sightings(given, rig("radtan"), SIDE_M, 0.3)
        np.testing.assert_allclose(found.t_body_marker_m, expected.t_body_marker_m, atol=1e-6)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-3, atol=1e-9)
        np.testing.assert_allclose(found.reprojection_px, expected.reprojection_px, rtol=1e-3)
        assert (found.ambiguous == expected.ambiguous).all()
    nothing = dataclasses.replace(corners, covariance_px2=np.full((50, 8, 8), np.nan))
    unknown, _ = corners_to_sightings(nothing, rig("radtan"), SIDE_M, 0.3)
    np.testing.assert_array_equal(unknown.t_body_marker_m, expected.t_body_marker_m)


def test_a_bad_corner_with_its_covariance_does_no_harm():
    covariance = 0.2**2 * np.eye(8)
    covariance[:2, :2] *= 15.0**2  # one corner hidden, say, by a hand: 3 px
    n = 300
    corners, rotation, position = _scene(
        np.random.default_rng(2), np.full(n, 100.0), np.full(n, 0.7), 0.0, np.repeat(covariance[None], n, axis=0)
    )
    weighed, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 0.2)
    blind, _ = corners_to_sightings(
        dataclasses.replace(corners, covariance_px2=None), rig("radtan"), SIDE_M, 0.2, worst_fit=100.0
    )
    assert len(weighed) > 0.97 * n
    miss = [
        np.median(np.linalg.norm(s.t_body_marker_m - position[s.marker.astype(int)], axis=1)) for s in (weighed, blind)
    ]
    assert miss[0] < 0.5 * miss[1]
    assert 5.0 < np.mean(_nees(weighed, rotation, position)[~weighed.ambiguous]) < 7.0


def test_a_covariance_that_is_none_is_refused():
    corners, _, _ = _scene(np.random.default_rng(3), np.full(3, 80.0), np.full(3, 0.6), 0.3)
    assert corners.covariance_px2 is not None
    covariance = corners.covariance_px2.copy()
    covariance[1, 0, 0] = -1.0
    with pytest.raises(SightingError, match=r"tags.csv:3: the covariance of its corners is not positive definite"):
        corners_to_sightings(dataclasses.replace(corners, covariance_px2=covariance), rig("radtan"), SIDE_M, 1.0)


@pytest.mark.parametrize("sigma_px", [0.1, 0.3])
def test_mean_nees_is_within_its_95_percent_band(sigma_px):
    n = 2000
    rng = np.random.default_rng(0)  # over twelve seeds the means are 5.97 (0.1 px) and 5.99 (0.3 px)
    size_px = np.exp(rng.uniform(np.log(20.0), np.log(200.0), n))
    corners, rotation, position = _scene(rng, size_px, np.deg2rad(rng.uniform(0.0, 60.0, n)), sigma_px)
    sightings, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 1.0, ambiguity_rule=ALONE)
    nees = _nees(sightings, rotation, position)
    assert len(sightings) > 0.999 * n
    assert abs(nees.mean() - 6.0) < 1.96 * np.sqrt(12.0 / n)
    assert 0.05 < sightings.ambiguous.mean() < 0.6
    # The first-order covariance of the better fitting solution knows nothing of the other one.
    first_order, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 1.0)
    assert _nees(first_order, rotation, position).mean() > 20.0
    assert np.median(_nees(first_order, rotation, position)) < 7.0


@pytest.mark.parametrize("tilt_deg", [0.0, 10.0, 20.0, 40.0, 60.0])
def test_far_frontal_and_noisy_markers_are_honest_too(tilt_deg):
    n = 2000
    corners, rotation, position = _scene(
        np.random.default_rng(5), np.full(n, 20.0), np.full(n, np.deg2rad(tilt_deg)), 0.3
    )
    sightings, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 1.0, ambiguity_rule=ALONE)
    assert sightings.ambiguous.mean() > 0.9
    assert 5.4 < _nees(sightings, rotation, position).mean() < 6.6  # 1.5 % of the side: no longer a small noise


def test_near_frontal_markers_whose_solutions_meet_are_not_ambiguous():
    n = 200
    corners, rotation, position = _scene(np.random.default_rng(6), np.full(n, 200.0), np.full(n, 0.02), 0.1)
    by_fit, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 1.0)
    assert by_fit.ambiguous.mean() > 0.9  # both solutions met at one minimum, and fit equally well
    sightings, _ = corners_to_sightings(corners, rig("radtan"), SIDE_M, 1.0, ambiguity_rule=ALONE)
    assert not sightings.ambiguous.any()
    assert 5.0 < _nees(sightings, rotation, position).mean() < 7.0
