"""Simulated camouflage: blobs of a few dull colours with fine texture."""

import cv2
import numpy as np
from jaxtyping import Float, Float32

# B, G, R. Dark green and olive lie near the reflector's hue, with less colour in them.
PALETTE_BGR = np.array(
    [[38, 66, 70], [36, 56, 44], [62, 98, 104], [28, 31, 30], [72, 108, 122], [57, 82, 66]], dtype=np.float64
)
# Blob sizes in pixels and how much each counts.
_OCTAVES = ((72, 1.0), (26, 0.5), (9, 0.25))
_GRAIN = 5.0
_SPECKLE_SHARE = 0.004
_SPECKLE_BGR = np.array([60.0, 130.0, 55.0])


def camouflage(rng: np.random.Generator, height: int, width: int) -> Float32[np.ndarray, "h w 3"]:
    """A canvas of camouflage, B, G, R from 0 to 255.

    The colour of a pixel is that whose smooth random field is highest there; a few leaf-green speckles lie on it.
    """
    fields = [
        sum(weight * _smooth(rng, height, width, size) for size, weight in _OCTAVES) for _ in range(len(PALETTE_BGR))
    ]
    canvas = PALETTE_BGR[np.argmax(np.stack(fields), axis=0)].astype(np.float32)
    speckle = _smooth(rng, height, width, 3)
    canvas[speckle > np.quantile(speckle[::4, ::4], 1.0 - _SPECKLE_SHARE)] = _SPECKLE_BGR
    return canvas + (_GRAIN * _smooth(rng, height, width, 2))[..., None]


def _smooth(rng: np.random.Generator, height: int, width: int, size: int) -> Float[np.ndarray, "h w"]:
    """Random field with unit variance at its nodes, `size` pixels apart."""
    nodes = rng.standard_normal((height // size + 3, width // size + 3)).astype(np.float32)
    return cv2.resize(nodes, (width, height), interpolation=cv2.INTER_CUBIC)
