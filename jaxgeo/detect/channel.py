"""The colour in which one marker parts best from what it lies on.

In gray a green marker on camouflage has no edge along half of its border, and a mask's edge sits where the range ends,
not half-way between two colours. A fixed mix of blue, green and red keeps the edge where it is (mixing is linear) and
can be chosen from the cells of the code, once that is known.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from jaxgeo.detect.reading import sample_cells

# Keeps the mix from amplifying noise where cells of a kind hardly differ: gray levels, squared.
_NOISE_LEVELS2 = 9.0
_BLACK, _WHITE = 64.0, 192.0


def marker_channel(
    bgr: UInt8[np.ndarray, "h w 3"],
    quad_px: Float[np.ndarray, "4 2"],
    white: Bool[np.ndarray, "r r"],
    black: Bool[np.ndarray, "r r"],
) -> Float32[np.ndarray, "h w"]:
    """A gray image in which the marker's black cells are 64 and its white cells 192, on average.

    Fisher's linear discriminant of the cells' colours: w = (S + noise)^-1 (mean white - mean black), with S the
    covariance within both kinds. Fisher, "The use of multiple measurements in taxonomic problems", 1936.

    Args:
        bgr: the image, or a part of it.
        quad_px: corners clockwise as seen, in the pixels of `bgr`.
        white, black: which cells are known to be so, in the order of `sample_cells`: inner cells, border and the ring
            outside.
    """
    cells = sample_cells(bgr, quad_px[None], len(white) - 4)[0]
    light, dark = cells[white], cells[black]
    within = (_scatter(light) + _scatter(dark)) / (len(light) + len(dark) - 2)
    difference = light.mean(axis=0) - dark.mean(axis=0)
    mix = np.linalg.solve(within + _NOISE_LEVELS2 * np.eye(3), difference)
    span = max(float(mix @ difference), 1e-9)
    mix *= (_WHITE - _BLACK) / span
    offset = (_WHITE + _BLACK) / 2 - mix @ (light.mean(axis=0) + dark.mean(axis=0)) / 2
    return cv2.transform(bgr.astype(np.float32), np.append(mix, offset)[None])


def white_cells(code: int, cells: int) -> Bool[np.ndarray, "r r"]:
    """Of a code as seen: its white cells, those of the ring outside among them, in the order of `sample_cells`."""
    white = np.ones((cells + 4, cells + 4), dtype=bool)
    white[1:-1, 1:-1] = False
    bits = (np.uint64(code) >> np.arange(cells * cells, dtype=np.uint64)) & np.uint64(1)
    white[2:-2, 2:-2] = bits.reshape(cells, cells).astype(bool)
    return white


def _scatter(colours: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "3 3"]:
    centred = colours - colours.mean(axis=0)
    return centred.T @ centred
