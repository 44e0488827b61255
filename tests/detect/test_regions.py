"""Regions: every marker lies in one, camouflage alone has hardly any (simulated)."""

import numpy as np

from jaxgeo.data import Camera
from jaxgeo.detect.mask import MaskSettings
from jaxgeo.detect.regions import find_regions
from jaxgeo.simulate.camouflage import camouflage
from jaxgeo.simulate.image_conditions import developed, sample_conditions
from jaxgeo.simulate.marker_image import render_marker_image, sample_marker

CAMERA = Camera(
    intrinsics_px=np.array([260.0, 260.0, 160.0, 120.0]),
    distortion_model="none",
    distortion=np.zeros(0),
    resolution_px=(320, 240),
    t_body_cam_m=np.zeros(3),
    quat_body_cam_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
)


def test_a_marker_of_any_size_lies_wholly_in_a_region():
    rng = np.random.default_rng(0)
    canvas = camouflage(rng, 240, 320)
    for side_px in np.geomspace(20.0, 120.0, 24):
        marker = sample_marker(rng, CAMERA, "apriltag_36h11", 8, side_px)
        image = render_marker_image(rng, CAMERA, canvas, [marker], sample_conditions(rng))
        low, high = image.corners_px[0].min(axis=0), image.corners_px[0].max(axis=0)
        boxes = find_regions(image.bgr, MaskSettings())
        assert np.any(np.all(boxes[:, :2] <= low, axis=1) & np.all(boxes[:, 2:] >= high, axis=1)), side_px


def test_camouflage_alone_has_hardly_any():
    rng = np.random.default_rng(1)
    none = np.zeros((0, 4, 2))
    counts = [
        len(find_regions(developed(rng, camouflage(rng, 240, 320), none, sample_conditions(rng)), MaskSettings()))
        for _ in range(10)
    ]
    assert np.mean(counts) < 2


def test_boxes_stay_within_the_image():
    image = np.full((50, 70, 3), (60, 190, 50), np.uint8)
    np.testing.assert_array_equal(find_regions(image, MaskSettings()), [[0, 0, 70, 50]])
    assert find_regions(np.zeros((50, 70, 3), np.uint8), MaskSettings()).shape == (0, 4)
