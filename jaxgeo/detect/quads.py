"""Quadrilaterals that may hold a code: from an image by OpenCV's marker detector, from a mask by its contours."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.detect.families import dictionary

# Share of an outline's length by which its polygon may leave it, and the largest share of the polygon's area that the
# outline may lack (a code's outer contour is full; that of a bush is not).
_POLYGON = (0.03, 0.06)
_FULL = 0.75


class OpenCVQuads:
    """Every candidate of OpenCV's marker detector, decoded by it or not.

    Its own decoder reads cells from a coarse, unrefined grid: on photographs of small tags it refuses some of the quads
    that it has found. Whether a quad holds a code is decided in `reading`.
    """

    def __init__(self, family: str, min_side_px: float):
        self._min_side_px = min_side_px
        self._parameters = cv2.aruco.DetectorParameters()
        self._dictionary = dictionary(family)

    def __call__(self, gray: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "q 4 2"]:
        """Corners clockwise as seen in the image."""
        self._parameters.minMarkerPerimeterRate = 4.0 * self._min_side_px / max(gray.shape)
        found, _, refused = cv2.aruco.ArucoDetector(self._dictionary, self._parameters).detectMarkers(gray)
        return _stack([quad[0] for quad in (*found, *refused)])


def mask_quads(
    mask: UInt8[np.ndarray, "h w"], min_side_px: float, *, outer: bool = False
) -> Float[np.ndarray, "q 4 2"]:
    """Quadrilaterals among the outlines of a mask (above 127), corners clockwise as seen in the image.

    `outer`: only outlines that lie in no other one.
    """
    _, binary = cv2.threshold(mask, 127, 255, cv2.THRESH_BINARY)
    outlines, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL if outer else cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    quads = []
    for outline in outlines:
        if len(outline) < 4 * 0.7 * min_side_px:
            continue
        quad = _polygon(outline)
        if quad is not None:
            quads.append(quad)
    return _stack(quads)


def _polygon(outline: np.ndarray) -> np.ndarray | None:
    """Four corners of a full outline; a hull first, so that a nibbled side does not count as corners."""
    hull = cv2.convexHull(outline)
    area = cv2.contourArea(hull)
    length = cv2.arcLength(hull, True)
    if area < 16.0 or cv2.contourArea(outline) < _FULL * area:
        return None
    for tolerance in _POLYGON:
        polygon = cv2.approxPolyDP(hull, tolerance * length, True)
        if len(polygon) == 4:
            return polygon[:, 0].astype(np.float64)
        if len(polygon) < 4:
            return None
    return None


def _stack(quads: Sequence[np.ndarray]) -> Float[np.ndarray, "q 4 2"]:
    """As one array, each convex quad turned clockwise as seen (y down)."""
    if not len(quads):
        return np.zeros((0, 4, 2))
    stacked = np.asarray(quads, dtype=np.float64)
    edge = np.roll(stacked, -1, axis=1) - stacked
    after = np.roll(edge, -1, axis=1)
    turn = edge[..., 0] * after[..., 1] - edge[..., 1] * after[..., 0]
    stacked = np.where((turn.sum(axis=1) < 0)[:, None, None], stacked[:, ::-1], stacked)
    return stacked[np.all(turn > 0, axis=1) | np.all(turn < 0, axis=1)]
