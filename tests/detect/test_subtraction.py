"""Pairs through two polarisers: the reflector remains, whatever light the polarisers take (simulated)."""

import cv2
import numpy as np
import pytest

from jaxgeo.data import Camera
from jaxgeo.detect import Detector, DetectorSettings
from jaxgeo.detect.subtraction import SubtractionSettings, subtract_cameras, subtract_in_time
from jaxgeo.errors import DetectError
from jaxgeo.simulate.camouflage import camouflage
from jaxgeo.simulate.image_conditions import ImageConditions, developed
from jaxgeo.simulate.marker_image import render_marker_image, sample_marker

CAMERA = Camera(
    intrinsics_px=np.array([260.0, 260.0, 160.0, 120.0]),
    distortion_model="none",
    distortion=np.zeros(0),
    resolution_px=(320, 240),
    t_body_cam_m=np.zeros(3),
    quat_body_cam_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
)
H_LEFT_RIGHT = np.array([[1.02, 0.03, -7.0], [-0.02, 0.99, 4.0], [1e-5, 2e-5, 1.0]])


def scene(rng, height=120, width=160):
    """A blotchy coloured ground, and where a reflector of four bars lies on it."""
    coarse = rng.uniform(60, 180, (height // 10, width // 10, 3)).astype(np.float32)
    ground = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    reflector = np.zeros((height, width), bool)
    for x in range(60, 100, 10):
        reflector[40:80, x : x + 5] = True
    return ground, reflector


def pictured(rng, ground, reflector, gain, glow):
    light = gain * (ground + glow * reflector[..., None]) + rng.normal(0, 1.5, ground.shape)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)


def iou(mask, reflector):
    return np.count_nonzero((mask > 0) & reflector) / np.count_nonzero((mask > 0) | reflector)


def test_in_time_only_the_reflector_remains_though_the_polariser_takes_light():
    rng = np.random.default_rng(1)
    ground, reflector = scene(rng)
    on, off = pictured(rng, ground, reflector, 0.55, 70.0), pictured(rng, ground, reflector, 1.0, 5.0)
    found = subtract_in_time(on, off, SubtractionSettings(blur_px=0.6))
    assert found.gain == pytest.approx(0.55, abs=0.01)
    assert iou(found.mask, reflector) > 0.9
    assert np.array_equal(found.mask > 0, found.difference > found.threshold)
    # Colour has no part in it: gray images give the same.
    gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (on, off)]
    assert np.array_equal(subtract_in_time(*gray, SubtractionSettings(blur_px=0.6)).mask, found.mask)


def test_without_a_reflector_noise_is_not_parted_in_two():
    rng = np.random.default_rng(2)
    ground, reflector = scene(rng)
    pair = [pictured(rng, ground, reflector, gain, 0.0) for gain in (1.0, 0.7)]
    assert not subtract_in_time(*pair).mask.any()
    assert subtract_in_time(*pair, SubtractionSettings(least_levels=0.0)).mask.any()


def test_a_fixed_threshold_is_kept_and_not_itself_above():
    first, second = np.full((20, 20), 100, np.uint8), np.full((20, 20), 100, np.uint8)
    first[:5], first[5:8] = 140, 141
    found = subtract_in_time(first, second, SubtractionSettings(blur_px=0.0, threshold=40.0))
    assert (found.gain, found.threshold) == (1.0, 40.0)
    assert np.array_equal(np.unique(np.nonzero(found.mask)[0]), [5, 6, 7])


def test_what_is_saturated_in_one_image_is_no_difference():
    ground = np.tile(np.linspace(20, 254, 80, dtype=np.float32), (60, 1))
    dim, bright = ground.astype(np.uint8), np.clip(1.4 * ground, 0, 255).astype(np.uint8)
    for pair in ((dim, bright), (bright, dim)):
        assert subtract_in_time(*pair, SubtractionSettings(blur_px=0.0)).difference.max() <= 2


def test_two_cameras_are_laid_over_each_other():
    rng = np.random.default_rng(3)
    ground, reflector = scene(rng)
    left = pictured(rng, ground, reflector, 1.0, 60.0)
    H_right_left = np.linalg.inv(H_LEFT_RIGHT)
    right = pictured(rng, cv2.warpPerspective(ground, H_right_left, (160, 120)), np.zeros_like(reflector), 0.8, 0.0)
    found = subtract_cameras(left, right, H_LEFT_RIGHT, SubtractionSettings(blur_px=0.6))
    assert iou(found.mask, reflector) > 0.85
    assert found.gain == pytest.approx(1 / 0.8, rel=0.02)
    # Not laid over each other, the ground itself differs.
    assert iou(subtract_cameras(left, right, np.eye(3)).mask, reflector) < 0.6


def test_where_only_one_camera_looks_nothing_is_found():
    left, right = np.full((60, 80), 90, np.uint8), np.full((60, 80), 90, np.uint8)
    left[10:20, 5:15] = 200  # beyond the right camera's picture, which begins at 30
    left[30:40, 25:45] = 200  # partly within it
    moved = np.array([[1.0, 0.0, 30.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = subtract_cameras(left, right, moved)
    assert not found.difference[:, :30].any()
    assert not found.difference[:25].any()
    assert found.mask[35, 35] == 255


def test_otsu_counts_only_what_both_cameras_see():
    left, right = np.full((60, 200), 100, np.uint8), np.full((60, 20), 100, np.uint8)
    left[36:51, 180:], left[51:, 180:] = 140, 200
    moved = np.array([[1.0, 0.0, 180.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = subtract_cameras(left, right, moved, SubtractionSettings(blur_px=0.0))
    # With 180 columns of zeros Otsu's level falls below 40.
    assert np.unique(found.difference[found.mask > 0]).tolist() == [100]


def test_a_marker_hidden_in_both_images_is_read_from_their_difference():
    rng = np.random.default_rng(5)
    canvas = camouflage(rng, 240, 320)
    marker = sample_marker(rng, CAMERA, "apriltag_36h11", 77, 80.0, most_tilt_rad=0.7, look="printed")
    shape = render_marker_image(rng, CAMERA, np.full_like(canvas, 226.0), [marker], ImageConditions())
    ink = shape.bgr.max(axis=2, keepdims=True) < 128
    noise, none = ImageConditions(defocus_px=0.5, read_noise=1.5), np.zeros((0, 4, 2))
    on = developed(rng, np.where(ink, canvas + 20.0, canvas).astype(np.float32), none, noise)
    off = developed(rng, (0.67 * canvas).astype(np.float32), none, noise)
    detector = Detector(DetectorSettings())
    assert len(detector(on)) == len(detector(off)) == 0
    difference = subtract_in_time(on, off).difference
    # Reflector is bright in the difference: turned round, a marker is black on white.
    found = detector(cv2.bitwise_not(cv2.normalize(difference, None, 0, 255, cv2.NORM_MINMAX)))
    assert found.marker.tolist() == [77]
    assert np.abs(found.corners_px - shape.corners_px).max() < 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda g: subtract_in_time(g, g[1:]), r"80 x 60 and 80 x 59 pixels"),
        (lambda g: subtract_in_time(g, g.astype(np.float32)), r"second image has shape \(60, 80\) and type float32"),
        (lambda g: subtract_in_time(g, np.zeros_like(g)), "fewer than 1 % of the pixels are well exposed"),
        (lambda g: subtract_cameras(g, g, np.zeros((3, 3))), "not singular"),
        (lambda g: subtract_cameras(g, g, np.diag([1.0, 1.0, np.nan])), "finite"),
        (lambda g: subtract_cameras(g, g, np.eye(2)), "3 x 3"),
        (lambda g: subtract_cameras(g, g, np.array([[1, 0, 500], [0, 1, 0], [0, 0, 1.0]])), "perhaps its inverse"),
        (lambda g: SubtractionSettings(blur_px=-1.0), "blur_px is -1.0"),
        (lambda g: SubtractionSettings(threshold=255.0), "threshold is 255.0"),
        (lambda g: SubtractionSettings(least_levels=float("nan")), "least_levels is nan"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(DetectError, match=message):
        call(np.full((60, 80), 90, np.uint8))
