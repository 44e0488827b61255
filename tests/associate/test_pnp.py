import dataclasses
import time

import cv2
import numpy as np
import pytest
import tagslam_session
from hypothesis import given, settings
from hypothesis import strategies as st
from marker_scene import BODY_CAM, CORNERS, camera, corner_sightings, corners_of, facing, pixels_of, rig
from scipy.spatial.transform import Rotation

from jaxgeo.associate.planar import square_poses
from jaxgeo.associate.pnp import corners_to_sightings
from jaxgeo.data import Rig
from jaxgeo.errors import SightingError

SIDE_M = 0.15


def _sightings(R, t, model="equidistant", noise_px=0.0, sigma_px=1.0, seed=0, **options):
    corners = corners_of(R, t, SIDE_M, camera(model))
    corners = corners + noise_px * np.random.default_rng(seed).normal(size=corners.shape)
    return corners_to_sightings(corner_sightings(corners), rig(model), SIDE_M, sigma_px, **options)


def _in_body(R, t):
    return Rotation.from_matrix(BODY_CAM.as_matrix() @ R), BODY_CAM.apply(t) + camera().t_body_cam_m


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(["none", "radtan", "equidistant"]),
    st.floats(0.2, 1.1),
    st.floats(-3.1, 3.1),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(0.4, 6.0),
    st.booleans(),
)
def test_exact_corners_give_the_exact_pose(model, tilt, about, x, y, range_m, mirrored):
    R, t = facing(tilt, about)[None], range_m * np.array([[x, y, 1.0]])
    if mirrored:  # x and y exchanged: the marker's z points away from the camera
        R = R @ np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    sightings, warnings = _sightings(R, t, model)
    rotation, position = _in_body(R, t)
    assert not warnings
    np.testing.assert_allclose(sightings.t_body_marker_m, position, atol=1e-7)
    error = rotation.inv() * Rotation.from_quat(sightings.quat_body_marker_wxyz, scalar_first=True)
    assert error.magnitude().max() < 1e-5
    assert sightings.reprojection_px.max() < 1e-5


def test_both_planar_solutions_equal_opencv():
    rng = np.random.default_rng(1)
    for _ in range(20):
        R, t = facing(rng.uniform(0.2, 1.2), rng.uniform(-3, 3)), np.array([*rng.uniform(-0.4, 0.4, 2), 1.0])
        points = SIDE_M * CORNERS @ R.T + t * rng.uniform(0.5, 4.0)
        normalised = points[:, :2] / points[:, 2:] + 1e-4 * rng.normal(size=(4, 2))
        _, rotvecs, translations, _ = cv2.solvePnPGeneric(
            SIDE_M * CORNERS, normalised[:, None], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        expected_R = [Rotation.from_rotvec(rotvec.ravel()).as_matrix() for rotvec in rotvecs]
        R_both, t_both = square_poses(normalised[None], np.array([SIDE_M]))
        for R_cv, t_cv in zip(expected_R, translations, strict=True):
            nearest = np.argmin([np.linalg.norm(R_both[0, k] - R_cv) for k in (0, 1)])
            np.testing.assert_allclose(R_both[0, nearest], R_cv, atol=1e-6)
            np.testing.assert_allclose(t_both[0, nearest], t_cv.ravel(), atol=1e-6)


def test_the_pose_minimises_the_distorted_reprojection_error():
    R, t = np.repeat(facing(0.7)[None], 30, axis=0), np.repeat([[0.8, -0.5, 1.2]], 30, axis=0)
    sightings, _ = _sightings(R, t, "equidistant", noise_px=0.5)
    corners = corners_of(R, t, SIDE_M, camera()) + 0.5 * np.random.default_rng(0).normal(size=(30, 4, 2))
    found = BODY_CAM.inv() * Rotation.from_quat(sightings.quat_body_marker_wxyz, scalar_first=True)
    centre = BODY_CAM.inv().apply(sightings.t_body_marker_m - camera().t_body_cam_m)

    def rms(rotation, position):
        return np.sqrt(
            np.mean((corners_of(rotation.as_matrix(), position, SIDE_M, camera()) - corners) ** 2, axis=(1, 2))
        )

    np.testing.assert_allclose(rms(found, centre), sightings.reprojection_px, rtol=1e-9)
    rng = np.random.default_rng(3)
    for scale in (1e-3, 1e-4):
        moved = rms(
            Rotation.from_rotvec(scale * rng.normal(size=(30, 3))) * found, centre + scale * rng.normal(size=(30, 3))
        )
        assert np.all(moved > sightings.reprojection_px)


@pytest.mark.parametrize("model", ["radtan", "equidistant"])
def test_covariance_equals_monte_carlo(model):
    n, sigma_px = 4000, 0.2
    R, t = np.repeat(facing(0.8)[None], n, axis=0), np.repeat([[0.3, -0.2, 1.0]], n, axis=0)
    sightings, _ = _sightings(R, t, model, noise_px=sigma_px, sigma_px=sigma_px)
    rotation, position = _in_body(R, t)
    turned = Rotation.from_quat(sightings.quat_body_marker_wxyz, scalar_first=True) * rotation.inv()
    error = np.column_stack([sightings.t_body_marker_m - position, turned.as_rotvec()])
    exact, _ = _sightings(R[:1], t[:1], model, sigma_px=sigma_px)
    white = np.linalg.solve(np.linalg.cholesky(exact.covariance[0]), error.T)
    np.testing.assert_allclose(np.cov(white), np.eye(6), atol=0.1)
    np.testing.assert_allclose(white.mean(axis=1), 0.0, atol=0.1)


def test_small_frontal_markers_are_ambiguous_and_large_tilted_ones_are_not():
    tilt = np.array([0.1, 1.0])
    R, t = np.stack([facing(a) for a in tilt]), np.array([[0.0, 0.0, 4.0], [0.1, 0.0, 0.8]])
    sightings, _ = _sightings(R, t, noise_px=0.3, sigma_px=0.3)
    assert sightings.ambiguous.tolist() == [True, False]
    exact, _ = _sightings(R, t, sigma_px=1.0)  # a perfect fit of the first does not make it unique
    assert exact.ambiguous.tolist() == [True, False]
    none, _ = _sightings(R, t, noise_px=0.3, sigma_px=0.3, ambiguity_ratio=0.0)
    assert not none.ambiguous.any()


def test_unambiguous_sightings_have_the_right_rotation():
    rng = np.random.default_rng(5)
    n, sigma_px = 1500, 0.3
    R = np.stack([facing(rng.uniform(0.0, 1.2), rng.uniform(-3, 3)) for _ in range(n)])
    t = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.ones(n)]) * rng.uniform(0.5, 4.0, (n, 1))
    sightings, _ = _sightings(R, t, noise_px=sigma_px, sigma_px=sigma_px)
    rotation, position = _in_body(R, t)
    error = Rotation.from_quat(sightings.quat_body_marker_wxyz, scalar_first=True) * rotation.inv()
    distance2 = np.einsum(
        "ni,nij,nj->n", error.as_rotvec(), np.linalg.inv(sightings.covariance[:, 3:, 3:]), error.as_rotvec()
    )
    clear = ~sightings.ambiguous
    assert 0.2 < clear.mean() < 0.9
    assert np.mean(distance2[clear] > 30.0) < 0.005
    assert np.mean(distance2[~clear] > 30.0) > 0.02
    # The centre hardly depends on the choice: also the ambiguous ones are right within a few of their own sigmas.
    miss = sightings.t_body_marker_m - position
    assert (
        np.median(np.einsum("ni,nij,nj->n", miss, np.linalg.inv(sightings.covariance[:, :3, :3]), miss)[~clear]) < 4.0
    )


def test_marker_sizes_by_id():
    R, t = facing(0.6)[None], np.array([[0.0, 0.1, 2.0]])
    corners = corners_of(R, t, 0.3, camera())
    _, position = _in_body(R, t)
    for sizes in ({"7": 0.3}, {"default": 0.3}, {"default": 0.15, "7": 0.3}):
        sightings, _ = corners_to_sightings(corner_sightings(corners), rig(), sizes, 1.0)
        np.testing.assert_allclose(sightings.t_body_marker_m, position, atol=1e-7)


@pytest.mark.parametrize(
    ("sizes", "sigma_px", "camera_name", "message"),
    [
        (0.15, 1.0, "cam9", r"tags.csv:2: camera 'cam9' is not in the rig, which has left.*camera_names"),
        ({"38": 0.3}, 1.0, "left", r"no marker size for id '7'.*given for 38.*'default'"),
        (-0.15, 1.0, "left", r"marker size of 'default' is -0.15 m.*above zero"),
        ({"7": 0.0}, 1.0, "left", r"marker size of '7' is 0.0 m"),
        (np.nan, 1.0, "left", r"marker size of 'default' is nan m"),
        (0.15, 0.0, "left", r"pixel_sigma_px is 0.0.*above zero"),
    ],
)
def test_wrong_arguments_are_refused(sizes, sigma_px, camera_name, message):
    corners = corner_sightings(corners_of(facing(0.5)[None], np.array([[0.0, 0.0, 1.0]]), SIDE_M, camera()))
    corners = corner_sightings(corners.corners_px, camera=camera_name)
    with pytest.raises(SightingError, match=message):
        corners_to_sightings(corners, rig(), sizes, sigma_px)


def test_impossible_corners_are_left_out_with_their_source():
    good = corners_of(facing(0.5)[None], np.array([[0.0, 0.0, 1.0]]), SIDE_M, camera())[0]
    outside = good + np.array([1200.0, 0.0])
    on_a_line = pixels_of(np.linspace([-0.1, -0.05, 1.0], [0.1, 0.05, 1.0], 4), camera())
    crossed = good[[0, 2, 1, 3]]
    bent = good + np.array([[0.0, 0.0], [0.0, 0.0], [14.0, 14.0], [0.0, 0.0]])
    corners = corner_sightings(np.stack([outside, good, on_a_line, crossed, bent]))
    sightings, warnings = corners_to_sightings(corners, rig(), SIDE_M, 0.5)
    assert sightings.source.tolist() == ["tags.csv:3"]
    assert "1 of 5 sightings have corners outside the image or the range" in warnings[0]
    assert "tags.csv:2." in warnings[0]
    assert "no marker in front of the camera" in warnings[1]
    assert "tags.csv:4, tags.csv:5." in warnings[1]
    assert "worse than 5 times pixel_sigma_px = 0.5 px" in warnings[2]
    assert "tags.csv:6." in warnings[2]
    with pytest.raises(SightingError, match="None is left: check intrinsics"):
        corners_to_sightings(corner_sightings(np.stack([outside, on_a_line])), rig(), SIDE_M, 1.0)


@pytest.mark.parametrize("model", ["none", "radtan", "equidistant"])
@pytest.mark.parametrize("huge", [1e9, 1e160, -1e200])
def test_huge_corners_are_left_out_without_overflow(model, huge):
    good = corners_of(facing(0.5)[None], np.array([[0.0, 0.0, 1.0]]), SIDE_M, camera(model))
    corners = np.concatenate([good, huge * np.arange(1.0, 9.0).reshape(1, 4, 2)])
    sightings, warnings = corners_to_sightings(corner_sightings(corners), rig(model), SIDE_M, 1.0)
    assert sightings.source.tolist() == ["tags.csv:2"]
    assert "outside the image or the range" in warnings[0]


def test_corners_outside_the_image_are_left_out_where_its_size_is_known():
    R, t = np.stack([facing(0.5)] * 2), np.array([[0.0, 0.0, 1.0], [1.7, 0.0, 1.0]])  # the second near u = 1290
    corners = corner_sightings(corners_of(R, t, SIDE_M, camera()))
    small = Rig(cameras={"left": dataclasses.replace(camera(), resolution_px=(1024, 1024))})
    unknown = Rig(cameras={"left": dataclasses.replace(camera(), resolution_px=None)})
    kept = [corners_to_sightings(corners, r, SIDE_M, 1.0)[0].source.tolist() for r in (rig(), small, unknown)]
    assert kept == [["tags.csv:2", "tags.csv:3"], ["tags.csv:2"], ["tags.csv:2", "tags.csv:3"]]


def test_corners_that_are_not_numbers_are_refused():
    corners = np.full((1, 4, 2), 500.0)
    corners[0, 2, 1] = np.nan
    with pytest.raises(SightingError, match=r"tags.csv:2: marker corners are not finite"):
        corners_to_sightings(corner_sightings(corners), rig(), SIDE_M, 1.0)


def test_real_corners_agree_with_the_reference_poses_and_between_the_cameras():
    session = tagslam_session.load(body="rig")
    corners = session.corners
    # Surveyed tags through the reference poses: the corner order and T_world_tag of data/README.
    R_body_world = Rotation.from_quat(session.reference.quat_wxyz, scalar_first=True).inv()
    pose = np.searchsorted(session.reference.stamp_s, corners.stamp_s)
    error = np.full((len(corners), 4), np.nan)
    for i in range(0, len(corners), 5):
        cam = session.rig.cameras[str(corners.camera[i])]
        tag = session.tags[str(corners.marker[i])]
        world = Rotation.from_rotvec(tag[4:7]).apply(SIDE_M * CORNERS) + tag[1:4]
        body = R_body_world[int(pose[i])].apply(world - session.reference.position_m[pose[i]])
        points = Rotation.from_quat(cam.quat_body_cam_wxyz, scalar_first=True).inv().apply(body - cam.t_body_cam_m)
        error[i] = np.linalg.norm(pixels_of(points, cam) - corners.corners_px[i], axis=1)
    assert 5.0 < np.nanmedian(error) < 6.0

    started = time.perf_counter()
    sightings, warnings = corners_to_sightings(corners, session.rig, SIDE_M, 0.5)
    assert time.perf_counter() - started < 2.0
    assert not warnings
    assert len(sightings) == len(corners) > 3600
    assert np.median(sightings.reprojection_px) < 0.1
    # Both cameras see one marker at one instant at one place, within what 0.5 px says.
    pairs = {}
    for row, seen in enumerate(zip(corners.stamp_s, corners.marker, strict=True)):
        pairs.setdefault(seen, []).append(row)
    a, b = np.array([rows for rows in pairs.values() if len(rows) == 2]).T
    gap = sightings.t_body_marker_m[a] - sightings.t_body_marker_m[b]
    spread = (sightings.covariance[a] + sightings.covariance[b])[:, :3, :3]
    nees = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(spread), gap) / 3.0
    assert len(a) > 1500
    assert 0.3 < nees.mean() < 3.0
    assert np.linalg.norm(gap, axis=1).mean() < 0.01
