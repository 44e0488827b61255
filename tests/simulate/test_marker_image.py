"""Simulated marker images: their truth is true, to a hundredth of a pixel."""

import dataclasses

import cv2
import numpy as np
import pytest

from jaxgeo.associate.camera_model import project
from jaxgeo.associate.planar import UNIT_CORNERS
from jaxgeo.data import Camera
from jaxgeo.detect import GREEN, Detector, DetectorSettings, MaskSettings
from jaxgeo.detect.mask import hsv_mask
from jaxgeo.errors import DetectError
from jaxgeo.simulate.camouflage import camouflage
from jaxgeo.simulate.image_conditions import ImageConditions, developed, motion_kernel, sample_conditions
from jaxgeo.simulate.marker_image import marker_corners_px, render_marker_image, sample_marker
from jaxgeo.simulate.marker_pattern import black_cells

WIDTH, HEIGHT = 320, 240


def camera(model: str = "radtan") -> Camera:
    coefficients = {"radtan": [-0.2, 0.05, 0.001, -0.001], "equidistant": [0.02, -0.01, 0.0, 0.0], "none": []}[model]
    return Camera(
        intrinsics_px=np.array([260.0, 255.0, 158.0, 122.0]),
        distortion_model=model,
        distortion=np.array(coefficients),
        resolution_px=(WIDTH, HEIGHT),
        t_body_cam_m=np.zeros(3),
        quat_body_cam_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
    )


def plain_background(level: float = 200.0) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), level, np.float32)


@pytest.mark.parametrize("model", ["radtan", "equidistant", "none"])
def test_true_corners_are_where_the_picture_has_them(model):
    """Seen by a detector that follows every edge, under every lens: no common shift beyond 0.03 px."""
    rng = np.random.default_rng(4)
    cam = camera(model)
    for _ in range(3):
        marker = sample_marker(rng, cam, "4x4_50", 17, 70.0, look="printed")
        image = render_marker_image(rng, cam, plain_background(), [marker], ImageConditions(defocus_px=0.6))
        found = Detector(DetectorSettings(families=("4x4_50",)))(image.bgr, cam)
        assert found.marker.tolist() == [17]
        assert np.abs(found.corners_px[0] - image.corners_px[0]).max() < 0.12
        assert np.abs((found.corners_px[0] - image.corners_px[0]).mean(axis=0)).max() < 0.03


def test_corners_are_the_projection_of_the_pose():
    rng = np.random.default_rng(0)
    marker = sample_marker(rng, camera("none"), "4x4_50", 0, 60.0)
    w, x, y, z = marker.quat_cam_marker_wxyz
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    points = marker.size_m * np.column_stack([UNIT_CORNERS, np.zeros(4)]) @ R.T + marker.t_cam_marker_m
    pixels = points[:, :2] / points[:, 2:] * [260.0, 255.0] + [158.0, 122.0]
    np.testing.assert_allclose(marker_corners_px(camera("none"), marker), pixels, atol=1e-6)
    assert np.all(project(points, camera("none"))[2])
    assert np.dot(R[:, 2], marker.t_cam_marker_m) < 0  # its face is turned to the camera


@pytest.mark.parametrize("family", ["5x5_100", "aruco_mip_36h12", "apriltag_25h9"])
def test_opencv_reads_the_print(family):
    rng = np.random.default_rng(1)
    marker = sample_marker(rng, camera(), family, 9, 90.0, look="printed", most_tilt_rad=0.5)
    image = render_marker_image(rng, camera(), plain_background(), [marker], ImageConditions(defocus_px=0.5))
    opencv = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family.upper()}"))
    corners, ids, _ = cv2.aruco.ArucoDetector(opencv).detectMarkers(cv2.cvtColor(image.bgr, cv2.COLOR_BGR2GRAY))
    assert ids.ravel().tolist() == [9]
    upper_left = 2 if family.startswith("apriltag") else 0  # OpenCV keeps AprilTags upside down
    expected = np.roll(image.corners_px[0][[3, 2, 1, 0]], -upper_left, axis=0)
    np.testing.assert_allclose(corners[0][0], expected, atol=1.5)


def test_reflector_lies_in_the_colour_range_and_camouflage_does_not():
    rng = np.random.default_rng(2)
    canvas = camouflage(rng, HEIGHT, WIDTH)
    empty = developed(rng, canvas.copy(), np.zeros((0, 4, 2)), ImageConditions(read_noise=2.0, shot_noise=3.0))
    assert np.mean(hsv_mask(empty, GREEN) > 0) < 0.03
    marker = sample_marker(rng, camera(), "apriltag_36h11", 3, 120.0, most_tilt_rad=0.2)
    image = render_marker_image(rng, camera(), canvas, [marker], ImageConditions(read_noise=2.0, shot_noise=3.0))
    cells = len(black_cells("apriltag_36h11", 3))
    quad = image.corners_px[0].astype(np.float32)
    unit = np.array([[0, cells], [cells, cells], [cells, 0], [0, 0]], np.float32)
    middles = np.argwhere(black_cells("apriltag_36h11", 3))[:, ::-1] + 0.5
    at = cv2.perspectiveTransform(middles[None].astype(np.float32), cv2.getPerspectiveTransform(unit, quad))[0]
    inside = hsv_mask(image.bgr, GREEN)[np.rint(at[:, 1]).astype(int), np.rint(at[:, 0]).astype(int)]
    assert np.mean(inside > 0) > 0.95


def test_a_camouflaged_marker_is_found_at_its_true_corners():
    rng = np.random.default_rng(5)
    canvas = camouflage(rng, HEIGHT, WIDTH)
    detector = Detector(DetectorSettings(mask=MaskSettings()))
    for i in range(4):
        marker = sample_marker(rng, camera(), "apriltag_36h11", 100 + i, 60.0)
        image = render_marker_image(rng, camera(), canvas, [marker], sample_conditions(rng))
        found = detector(image.bgr, camera())
        assert found.marker.tolist() == [100 + i]
        assert np.abs(found.corners_px - image.corners_px).max() < 0.6


def test_dark_lines_on_a_green_board_are_read_through_the_inverted_mask():
    rng = np.random.default_rng(6)
    marker = sample_marker(rng, camera(), "apriltag_36h11", 42, 90.0, look="ground", most_tilt_rad=0.6)
    image = render_marker_image(
        rng, camera(), camouflage(rng, HEIGHT, WIDTH), [marker], ImageConditions(defocus_px=0.5)
    )
    for polarity, expected in (("ground", [42]), ("auto", [42]), ("marker", [])):
        found = Detector(DetectorSettings(mask=MaskSettings(polarity=polarity)))(image.bgr, camera())
        assert found.marker.tolist() == expected


def test_the_same_seed_gives_the_same_bytes():
    def once() -> np.ndarray:
        rng = np.random.default_rng(7)
        canvas = camouflage(rng, HEIGHT, WIDTH)
        marker = sample_marker(rng, camera(), "4x4_50", 1, 40.0)
        return render_marker_image(rng, camera(), canvas, [marker], sample_conditions(rng, most_occlusion=0.2)).bgr

    np.testing.assert_array_equal(once(), once())


@pytest.mark.parametrize(("length_px", "angle_rad"), [(2.3, 0.4), (5.0, 2.0), (0.7, 1.5)])
def test_motion_blur_shifts_nothing(length_px, angle_rad):
    kernel = motion_kernel(length_px, angle_rad)
    np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-6)
    assert kernel.sum() == pytest.approx(1.0, abs=1e-6)
    at = np.arange(len(kernel)) - len(kernel) // 2
    spread = np.sqrt((kernel.sum(axis=0) @ at**2) + (kernel.sum(axis=1) @ at**2))
    assert spread == pytest.approx(length_px / np.sqrt(12.0), abs=0.5)


def test_a_leaf_hides_the_share_asked_for():
    rng = np.random.default_rng(8)
    marker = sample_marker(rng, camera("none"), "4x4_50", 1, 100.0, look="printed", most_tilt_rad=0.1)
    shown = render_marker_image(rng, camera("none"), plain_background(), [marker], ImageConditions()).bgr
    hidden = render_marker_image(rng, camera("none"), plain_background(), [marker], ImageConditions(occlusion=0.2)).bgr
    outline = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillConvexPoly(outline, np.rint(marker_corners_px(camera("none"), marker)).astype(np.int32), 1)
    share = np.mean(np.any(shown != hidden, axis=2)[outline > 0])
    assert 0.12 < share < 0.28


def test_a_marker_behind_the_camera_is_refused():
    rng = np.random.default_rng(9)
    marker = sample_marker(rng, camera(), "4x4_50", 1, 40.0)
    with pytest.raises(DetectError, match="wholly in front of the camera"):
        marker_corners_px(camera(), dataclasses.replace(marker, t_cam_marker_m=-marker.t_cam_marker_m))
    with pytest.raises(DetectError, match="shows its back"):
        marker_corners_px(camera(), dataclasses.replace(marker, quat_cam_marker_wxyz=np.array([1.0, 0.0, 0.0, 0.0])))
    with pytest.raises(DetectError, match="ids 0 to 49, not 50"):
        black_cells("4x4_50", 50)


def test_a_marker_beside_the_image_leaves_it_as_it_was():
    rng = np.random.default_rng(9)
    marker = sample_marker(rng, camera("none"), "4x4_50", 1, 40.0, most_tilt_rad=0.1)
    beside = dataclasses.replace(marker, t_cam_marker_m=np.array([3.0, 0.0, 1.0]))
    image = render_marker_image(rng, camera("none"), plain_background(), [beside], ImageConditions())
    assert np.all(image.bgr == 200)
