"""Corners from sides: right, and as sure as they say."""

import numpy as np
import pytest
from printed_marker import printed, slanted

from jaxgeo.detect.edges import refine_corners

SHAPE = (160, 200)


@pytest.mark.parametrize(("side_px", "worst_px"), [(24.0, 0.12), (60.0, 0.05), (110.0, 0.08)])
def test_clean_corners_are_found_to_hundredths(side_px, worst_px):
    rng = np.random.default_rng(0)
    for turn in (0.0, 0.4, 0.9):
        truth = slanted(side_px, (98.3, 77.6), turn)
        image = printed("apriltag_36h11", 7, truth, SHAPE)
        start = truth + rng.uniform(-1.0, 1.0, (4, 2))
        found = refine_corners(image, start[None], 6)
        assert found.ok[0]
        assert np.abs(found.corners_px[0] - truth).max() < worst_px


def test_the_covariance_is_that_of_the_scatter():
    """Corners of 300 noisy pictures of one marker: squared errors over their covariance average 8."""
    rng = np.random.default_rng(1)
    truth = slanted(48.0, (98.3, 77.6), 0.4)
    clean = printed("apriltag_36h11", 7, truth, SHAPE).astype(np.float64)
    ratio = []
    for _ in range(300):
        image = np.clip(clean + rng.normal(0.0, 8.0, SHAPE), 0, 255).round().astype(np.uint8)
        found = refine_corners(image, truth[None] + rng.uniform(-0.5, 0.5, (1, 4, 2)), 6)
        error = (found.corners_px[0] - truth).reshape(8)
        ratio.append(error @ np.linalg.solve(found.covariance_px2[0], error))
    assert 6.0 < np.mean(ratio) < 10.0


def test_corners_move_with_the_picture():
    truth = slanted(48.0, (98.0, 77.0), 0.4)
    image = printed("apriltag_36h11", 7, truth, SHAPE)
    found = refine_corners(image, truth[None], 6).corners_px
    shifted = refine_corners(np.roll(image, (3, 5), axis=(0, 1)), truth[None] + np.array([5.0, 3.0]), 6).corners_px
    np.testing.assert_allclose(shifted, found + np.array([5.0, 3.0]), atol=1e-3)


def test_a_bright_border_is_followed_too():
    truth = slanted(48.0, (98.0, 77.0), 0.4)
    image = 255 - printed("apriltag_36h11", 7, truth, SHAPE)
    found = refine_corners(image, truth[None], 6, dark_inside=False)
    assert np.abs(found.corners_px[0] - truth).max() < 0.1


def test_where_there_is_no_edge_the_start_stays():
    start = slanted(48.0, (98.0, 77.0), 0.4)[None]
    found = refine_corners(np.full(SHAPE, 90, np.uint8), start, 6)
    assert not found.ok[0]
    np.testing.assert_array_equal(found.corners_px, start)
