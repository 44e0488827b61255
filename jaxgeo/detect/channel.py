"""The colour in which one marker parts best from what it lies on.

In gray a green marker on camouflage has no edge along half of its border, and a mask's edge sits where the range ends,
not half-way between two colours. A fixed mix of blue, green and red keeps the edge where it is (mixing is linear) and
can be chosen from the cells of the code, once that is known.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

# Keeps the mix from amplifying noise where cells of a kind hardly differ: gray levels, squared.
_NOISE_LEVELS2 = 9.0
_BLACK, _WHITE = 64.0, 192.0


class Mix(NamedTuple):
    """Gray level = weights . (B, G, R) + offset."""

    weights: Float[np.ndarray, "3"]
    offset: float


def best_mix(
    cells_bgr: Float[np.ndarray, "r r 3"], white: Bool[np.ndarray, "r r"], black: Bool[np.ndarray, "r r"]
) -> Mix:
    """The mix in which the black cells are 64 and the white ones 192, on average, and scatter least.

    Fisher's linear discriminant of the cells' colours: w = (S + noise)^-1 (mean white - mean black), with S the
    covariance within both kinds. Fisher, "The use of multiple measurements in taxonomic problems", 1936.

    Args:
        cells_bgr: mean colours, as `sample_cells` gives them.
        white, black: which cells are known to be so.
    """
    light, dark = cells_bgr[white], cells_bgr[black]
    mean_light, mean_dark = light.sum(axis=0) / len(light), dark.sum(axis=0) / len(dark)
    light, dark = light - mean_light, dark - mean_dark
    within = (light.T @ light + dark.T @ dark) / (len(light) + len(dark) - 2)
    difference = mean_light - mean_dark
    weights = np.linalg.solve(within + _NOISE_LEVELS2 * np.eye(3), difference)
    weights *= (_WHITE - _BLACK) / max(float(weights @ difference), 1e-9)
    return Mix(weights, float((_WHITE + _BLACK) / 2 - weights @ (mean_light + mean_dark) / 2))


def mixed(bgr: UInt8[np.ndarray, "h w 3"], mix: Mix) -> Float32[np.ndarray, "h w"]:
    """The gray image of a mix."""
    return cv2.transform(bgr.astype(np.float32), np.append(mix.weights, mix.offset)[None])


def white_cells(code: int, cells: int) -> Bool[np.ndarray, "r r"]:
    """Of a code as seen: its white cells, those of the ring outside among them, in the order of `sample_cells`."""
    white = np.ones((cells + 4, cells + 4), dtype=bool)
    white[1:-1, 1:-1] = False
    bits = (np.uint64(code) >> np.arange(cells * cells, dtype=np.uint64)) & np.uint64(1)
    white[2:-2, 2:-2] = bits.reshape(cells, cells).astype(bool)
    return white
