"""A screen capture of a real iMarker: invisible to the eye, its lines are holes in the mask of their board."""

import cv2
import numpy as np
import pytest
from data_root import data_root

from jaxgeo.detect.mask import HsvRange, MaskSettings, hsv_mask
from jaxgeo.detect.regions import find_regions

BOARD = HsvRange((60, 100, 20), (81, 255, 120))


@pytest.fixture(scope="module")
def camera_picture():
    """The camera's picture within the capture, smoothed: the capture has 256 colours, dithered."""
    path = data_root() / "imarkers" / "demo_frames" / "f033.png"
    frame = cv2.imread(str(path))
    assert frame is not None, path
    return cv2.GaussianBlur(frame[132:467, 9:260], (0, 0), 1.0)


def test_the_lines_are_outside_the_range_and_their_ground_is_inside(camera_picture):
    mask = hsv_mask(camera_picture, BOARD) > 0
    assert mask[140:146, 148:168].mean() < 0.2  # the bar of the code
    bottom_line = [mask[int(180 - 0.22 * (x - 147)) - 2 :, x][:6].all() for x in range(150, 190)]
    assert np.mean(bottom_line) < 0.3  # hardly a column without a dark pixel on it
    assert mask[150:165, 155:180].mean() > 0.9  # between bar and outline
    assert mask[180:230, 170:245].mean() > 0.9  # the board beside the marker


def test_the_region_holds_the_board(camera_picture):
    boxes = find_regions(camera_picture, MaskSettings(BOARD, "ground"))
    assert len(boxes) == 1
    x0, y0, x1, y1 = boxes[0]
    # The board's corner is at (119, 132) of 251 x 335; right and below it leaves the picture.
    assert 40 < x0 < 119
    assert 30 < y0 < 132
    assert (x1, y1) == (251, 335)
