"""Corners from all edges of a code: right, as sure as they say, and blind to light that spills over."""

import cv2
import numpy as np
import pytest
from printed_marker import printed, slanted

from jaxgeo.detect.channel import white_cells
from jaxgeo.detect.code_edges import cell_edges, refine_with_code
from jaxgeo.detect.edges import refine_corners
from jaxgeo.detect.families import family

SHAPE = (160, 200)
CODE = white_cells(int(family("aruco_mip_36h12").codes[7, 0]), 6)


def picture(truth: np.ndarray) -> np.ndarray:
    return printed("aruco_mip_36h12", 7, truth, SHAPE)


def test_every_edge_points_from_black_to_white():
    edges = cell_edges(CODE)
    for sign, white in ((-0.5, False), (0.5, True)):
        cell = np.floor((edges.middle + sign * edges.outward) * 8).astype(int) + 1
        assert np.all(CODE[cell[:, 1], cell[:, 0]] == white)
    along_rows = np.count_nonzero(CODE[:, 1:] != CODE[:, :-1])
    assert len(edges.middle) == along_rows + np.count_nonzero(CODE[1:] != CODE[:-1])


@pytest.mark.parametrize(("side_px", "worst_px"), [(24.0, 0.09), (60.0, 0.04), (110.0, 0.06)])
def test_clean_corners_are_found_to_hundredths(side_px, worst_px):
    rng = np.random.default_rng(0)
    for turn in (0.0, 0.4, 0.9):
        truth = slanted(side_px, (98.3, 77.6), turn)
        found = refine_with_code(picture(truth), truth + rng.uniform(-0.7, 0.7, (4, 2)), CODE)
        assert found.ok[0]
        assert np.abs(found.corners_px[0] - truth).max() < worst_px


@pytest.mark.parametrize("side_px", [32.0, 64.0])
def test_the_covariance_is_that_of_the_scatter(side_px):
    """Corners of 300 noisy pictures of one marker: squared errors over their covariance average 8, less in
    small markers, whose covariance allows for blur between edges that this picture lacks."""
    rng = np.random.default_rng(1)
    truth = slanted(side_px, (98.3, 77.6), 0.4)
    clean = picture(truth).astype(np.float64)
    ratio = []
    for _ in range(300):
        image = np.clip(clean + rng.normal(0.0, 8.0, SHAPE), 0, 255).round().astype(np.uint8)
        found = refine_with_code(image, truth + rng.uniform(-0.5, 0.5, (4, 2)), CODE)
        error = (found.corners_px[0] - truth).reshape(8)
        ratio.append(error @ np.linalg.solve(found.covariance_px2[0], error))
    assert 3.0 < np.mean(ratio) < 11.0


def test_light_that_spills_over_moves_no_corner():
    """White grown by half a pixel on every edge: the sides move in by as much, the code's fit stays."""
    truth = slanted(64.0, (98.3, 77.6), 0.4)
    big = cv2.resize(picture(truth), None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    spilled = cv2.dilate(big, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5)))
    image = cv2.resize(spilled, SHAPE[::-1], interpolation=cv2.INTER_AREA)
    with_code = np.abs(refine_with_code(image, truth, CODE).corners_px[0] - truth).max()
    sides = np.abs(refine_corners(image, truth[None], 6).corners_px[0] - truth).max()
    assert with_code < 0.1 < 0.35 < sides


def test_where_there_is_no_edge_the_start_stays():
    start = slanted(48.0, (98.0, 77.0), 0.4)
    found = refine_with_code(np.full(SHAPE, 90, np.uint8), start, CODE)
    assert not found.ok[0] or np.abs(found.corners_px[0] - start).max() < 1.0
