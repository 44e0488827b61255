"""The print of a marker: which of its cells are black."""

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from jaxgeo.detect.families import dictionary, family_name
from jaxgeo.errors import DetectError


def black_cells(family: str, marker: int) -> Bool[np.ndarray, "n n"]:
    """Cells of the upright print, border included, from its upper left.

    Raises:
        DetectError: no such family, or no such id.
    """
    opencv = dictionary(family)
    if not 0 <= marker < opencv.bytesList.shape[0]:
        raise DetectError(f"{family} has ids 0 to {opencv.bytesList.shape[0] - 1}, not {marker}.")
    black = cv2.aruco.generateImageMarker(opencv, marker, opencv.markerSize + 2) < 128
    # OpenCV keeps AprilTags turned by half a turn against AprilTag's own prints.
    return black[::-1, ::-1] if family_name(family).startswith("apriltag") else black


def texture(black: Bool[np.ndarray, "n n"], texels: int, quiet_cells: int) -> Float32[np.ndarray, "t t"]:
    """1 on black cells, 0 elsewhere, `texels` a cell, with `quiet_cells` of 0 all round."""
    padded = np.pad(black.astype(np.float32), quiet_cells)
    return np.kron(padded, np.ones((texels, texels), np.float32))
