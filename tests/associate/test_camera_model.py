import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marker_scene import camera, pixels_of

from jaxgeo.associate.camera_model import check_camera, max_radius, project, undistort
from jaxgeo.data import Camera
from jaxgeo.errors import SightingError

MODELS = ["none", "radtan", "radtan5", "equidistant"]


def _points(radius: float) -> np.ndarray:
    side = np.linspace(-radius, radius, 15)
    x, y = (grid.ravel() for grid in np.meshgrid(side, side))
    depth = 0.5 + np.abs(x) + 0.3 * np.abs(y)
    return np.column_stack([x, y, np.ones_like(x)]) * depth[:, None]


@pytest.mark.parametrize("model", MODELS)
def test_project_equals_the_textbook_formula(model):
    points = _points(0.8)
    pixels, _, ok = project(points, camera(model))
    assert ok.all()
    np.testing.assert_allclose(pixels, pixels_of(points, camera(model)), atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_project_jacobian_equals_finite_differences(model):
    points, step = _points(0.7), 1e-6
    _, jacobian, _ = project(points, camera(model))
    for axis in range(3):
        ahead, behind = points.copy(), points.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        numeric = (pixels_of(ahead, camera(model)) - pixels_of(behind, camera(model))) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:, :, axis], numeric, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("model", MODELS)
def test_undistort_inverts_the_textbook_formula(model):
    points = _points(0.8)
    normalised, ok = undistort(pixels_of(points, camera(model)), camera(model))
    assert ok.all()
    np.testing.assert_allclose(normalised, points[:, :2] / points[:, 2:], atol=1e-6)


@given(st.floats(0.0, 2.0 * np.pi), st.floats(0.0, np.deg2rad(85.0)))
def test_fisheye_is_inverted_far_off_the_axis(azimuth, angle):
    point = np.array([[np.tan(angle) * np.cos(azimuth), np.tan(angle) * np.sin(azimuth), 1.0]])
    normalised, ok = undistort(pixels_of(point, camera()), camera())
    assert ok.all()
    np.testing.assert_allclose(normalised, point[:, :2], rtol=1e-6, atol=1e-9)


def test_pixels_beyond_the_fisheye_range_are_flagged():
    pixels = np.array([[665.0, 554.3], [665.0 + 603.9 * 1.75, 554.3], [1e5, 0.0]])  # on axis, past 90 degrees, nowhere
    normalised, ok = undistort(pixels, camera())
    assert ok.tolist() == [True, False, False]
    np.testing.assert_array_equal(normalised[~ok], 0.0)


def test_pixels_at_right_angles_to_the_axis_are_flagged_without_distortion():
    _, ok = undistort(np.array([[665.0 + 603.9 * 50.0, 554.3], [665.0 + 603.9 * 60.0, 554.3]]), camera("none"))
    assert ok.tolist() == [True, False]  # tan 89 degrees is 57.3


def _barrel(model: str) -> Camera:
    """A lens so strong that its radial polynomial turns back, without tangential terms."""
    coefficients = np.array([-0.5, 0.05, 0.0, 0.0, -0.01])[: camera(model).distortion.size]
    return dataclasses.replace(camera(model), distortion=coefficients)


def test_pixels_beyond_the_turning_point_of_radtan_are_flagged():
    cam = _barrel("radtan")
    at = max_radius(cam)
    farthest = pixels_of(np.array([[at, 0.0, 1.0]]), cam)[0]
    _, ok = undistort(farthest + np.array([[-30.0, 0.0], [30.0, 0.0]]), cam)
    assert ok.tolist() == [True, False]


def test_points_behind_the_camera_or_out_of_range_are_flagged():
    cam = _barrel("radtan")
    beyond = 1.05 * max_radius(cam)
    pixels, _, ok = project(np.array([[0.1, 0.0, 1.0], [0.1, 0.0, -1.0], [0.1, 0.0, 0.0], [beyond, 0.0, 1.0]]), cam)
    assert ok.tolist() == [True, False, False, False]
    assert np.isfinite(pixels).all()


@pytest.mark.parametrize("model", ["radtan", "radtan5"])
def test_max_radius_is_where_the_distorted_radius_turns_back(model):
    cam = _barrel(model)
    r = np.linspace(0.0, 1.2 * max_radius(cam), 200_001)
    distorted = pixels_of(np.column_stack([r, 0.0 * r, 1.0 + 0.0 * r]), cam)[:, 0]
    turn = r[np.flatnonzero(np.diff(distorted) < 0.0)[0]]
    assert max_radius(cam) == pytest.approx(turn, rel=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distortion_model": "fov"}, "'left'.*'fov' is not known.*equidistant, none, radtan"),
        ({"distortion": np.zeros(3)}, "3 distortion coefficients for model 'equidistant'; expected 4"),
        ({"intrinsics_px": np.array([600.0, -600.0, 640.0, 512.0])}, "not positive.*fx, fy, cx, cy"),
        ({"intrinsics_px": np.array([600.0, np.nan, 640.0, 512.0])}, "not finite"),
    ],
)
def test_unusable_cameras_are_refused(change, message):
    with pytest.raises(SightingError, match=message):
        check_camera("left", dataclasses.replace(camera(), **change))
