"""Codes read from quadrilaterals: any dictionary, any quarter turn, uneven light."""

import cv2
import numpy as np
import pytest
from printed_marker import printed, slanted

from jaxgeo.detect.families import family
from jaxgeo.detect.reading import in_print_order, read_codes, sample_cells, unit_homographies

SHAPE = (160, 200)
CORNERS = slanted(70.0, (98.3, 77.6), 0.3)


@pytest.mark.parametrize("name", ["4x4_50", "5x5_250", "aruco_mip_36h12", "apriltag_36h11", "7x7_1000"])
@pytest.mark.parametrize("first", [0, 1, 2, 3])
def test_the_print_is_read_from_any_corner(name, first):
    one = family(name)
    quad = np.roll(CORNERS, -first, axis=0)[None]
    reading = read_codes(printed(name, 21, CORNERS, SHAPE), quad, [one])
    assert (reading.marker[0], reading.hamming[0]) == (21, 0)
    assert reading.border_errors[0] == 0
    assert reading.margin[0] > 0.9
    upper_left = 2 if name.startswith("apriltag") else 0  # OpenCV prints AprilTags upside down
    expected = np.roll(CORNERS, -upper_left, axis=0)[[3, 2, 1, 0]]
    np.testing.assert_array_equal(in_print_order(quad, reading.quarter_turns)[0], expected)


def test_light_that_falls_off_is_no_pattern():
    image = printed("apriltag_36h11", 5, CORNERS, SHAPE, black=60).astype(np.float64)
    shade = np.linspace(0.25, 1.0, SHAPE[1])[None, :]
    reading = read_codes((image * shade).astype(np.uint8), CORNERS[None], [family("apriltag_36h11")])
    assert (reading.marker[0], reading.hamming[0]) == (5, 0)


def test_a_flat_gray_field_reads_without_margin():
    reading = read_codes(np.full(SHAPE, 90, np.uint8), CORNERS[None], [family("4x4_50")])
    assert abs(reading.contrast[0]) < 1.0


def test_the_family_with_fewer_wrong_bits_wins():
    image = printed("6x6_250", 8, CORNERS, SHAPE)
    families = [family("apriltag_36h11"), family("6x6_250")]
    reading = read_codes(image, CORNERS[None], families)
    assert (families[reading.family[0]].name, reading.marker[0]) == ("6x6_250", 8)


def test_cells_carry_colour_too():
    image = cv2.merge([printed("4x4_50", 3, CORNERS, SHAPE), np.zeros(SHAPE, np.uint8), np.full(SHAPE, 7, np.uint8)])
    cells = sample_cells(image, CORNERS[None], 4)
    assert cells.shape == (1, 8, 8, 3)
    np.testing.assert_allclose(cells[..., 1:], np.broadcast_to([0.0, 7.0], (1, 8, 8, 2)))


def test_homographies_are_opencv_s():
    quads = np.stack([CORNERS, slanted(20.0, (40.0, 60.0), 2.0)])
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    for homography, quad in zip(unit_homographies(quads), quads, strict=True):
        oracle = cv2.getPerspectiveTransform(unit, quad.astype(np.float32))
        np.testing.assert_allclose(homography / homography[2, 2], oracle, atol=1e-3)
