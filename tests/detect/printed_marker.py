"""A printed marker drawn by OpenCV's warp, with its true corners: for tests that need no camera."""

import cv2
import numpy as np

from jaxgeo.detect.families import dictionary

PIXELS_A_CELL = 20


def printed(
    family: str, marker: int, corners_px: np.ndarray, shape: tuple[int, int], *, black: int = 30, white: int = 220
) -> np.ndarray:
    """A gray image with one marker as OpenCV prints it; its corners (4, 2) upper left, upper right, lower right, lower
    left, in pixels whose centres are whole numbers. Blurred a little, as by any lens."""
    opencv = dictionary(family)
    cells = opencv.markerSize + 2
    print_ = cv2.aruco.generateImageMarker(opencv, marker, cells * PIXELS_A_CELL)
    side = cells * PIXELS_A_CELL
    room = 2 * PIXELS_A_CELL
    paper = np.pad(print_, room, constant_values=255)
    paper = np.where(paper > 127, white, black).astype(np.uint8)
    edges = np.array([[0, 0], [side, 0], [side, side], [0, side]]) + room - 0.5
    big = 10  # ten by ten samples a pixel: an area average, not a point
    target = (np.asarray(corners_px) + 0.5) * big - 0.5
    warp = cv2.getPerspectiveTransform(edges.astype(np.float32), target.astype(np.float32))
    image = cv2.warpPerspective(
        paper, warp, (shape[1] * big, shape[0] * big), flags=cv2.INTER_AREA, borderValue=float(white)
    )
    small = cv2.resize(image, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), 0.6)


def slanted(side_px: float, middle_px: tuple[float, float], turn_rad: float) -> np.ndarray:
    """A square seen at a slant: corners upper left, upper right, lower right, lower left."""
    unit = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * side_px
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turned = unit @ np.array([[c, s], [-s, c]])
    flattened = turned * [1.0, 0.8]
    return flattened * (1.0 + 0.1 * turned[:, 1:] / side_px) + middle_px
