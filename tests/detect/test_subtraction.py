"""Two polarised pictures: a marker hidden in each alone is read from their difference (simulated)."""

import cv2
import numpy as np
import pytest

from jaxgeo.data import Camera
from jaxgeo.detect import Detector, DetectorSettings
from jaxgeo.detect.subtraction import camera_difference, difference_mask, temporal_difference
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
NOISE = ImageConditions(defocus_px=0.5, read_noise=1.5)


def pair() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """With and without the reflector's light, the second a third darker; the marker is a tenth brighter only."""
    rng = np.random.default_rng(3)
    canvas = camouflage(rng, 240, 320)
    marker = sample_marker(rng, CAMERA, "apriltag_36h11", 77, 80.0, most_tilt_rad=0.7, look="printed")
    shape = render_marker_image(rng, CAMERA, np.full_like(canvas, 226.0), [marker], ImageConditions())
    ink = (shape.bgr.max(axis=2) < 128)[..., None]
    on = developed(rng, np.where(ink, canvas + 14.0, canvas).astype(np.float32), np.zeros((0, 4, 2)), NOISE)
    off = developed(rng, 0.67 * canvas, np.zeros((0, 4, 2)), NOISE)
    return on, off, shape.corners_px


def test_the_marker_is_read_from_the_difference_only():
    on, off, corners = pair()
    detector = Detector(DetectorSettings())
    assert len(detector(on)) == len(detector(off)) == 0
    difference = temporal_difference(on, off)
    scaled = cv2.normalize(difference, None, 0, 255, cv2.NORM_MINMAX)
    found = detector(cv2.bitwise_not(scaled))
    assert found.marker.tolist() == [77]
    assert np.abs(found.corners_px - corners).max() < 1.0
    mask = difference_mask(difference) > 0
    outline = np.zeros((240, 320), np.uint8)
    cv2.fillConvexPoly(outline, np.rint(corners[0]).astype(np.int32), 1)
    assert mask[outline == 0].mean() < 0.05 < 0.3 < mask[outline > 0].mean()


def test_two_cameras_are_one_after_the_homography():
    on, off, _ = pair()
    shift = np.array([[1.0, 0.0, 7.0], [0.0, 1.0, -4.0], [0.0, 0.0, 1.0]])
    right = np.roll(off, (4, -7), axis=(0, 1))
    two = camera_difference(on, right, shift)
    one = temporal_difference(on, off)
    inner = np.s_[10:-10, 12:-12]
    np.testing.assert_allclose(two[inner].astype(int), one[inner].astype(int), atol=2)
    assert np.all(two[:, :5] == 0)  # the right camera does not see there


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda a: temporal_difference(a, a[:-1]), "expected two of one size"),
        (lambda a: temporal_difference(a[..., 0], a[..., 0]), "colour bytes"),
        (lambda a: camera_difference(a, a, np.zeros((3, 3))), "finite and invertible"),
        (lambda a: difference_mask(a[..., 0], 300), "threshold 300"),
    ],
)
def test_bad_pictures_are_named(call, message):
    with pytest.raises(DetectError, match=message):
        call(np.zeros((8, 9, 3), np.uint8))
