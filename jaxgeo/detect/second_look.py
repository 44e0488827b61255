"""Where a small quadrilateral failed to decode: the places to look at once more, enlarged.

Thresholds and polygons are found on whole pixels. Twice as large, the outline of a 15-pixel marker comes out better;
enlarging whole images would cost four times the time for the same gain.
"""

import numpy as np
from jaxtyping import Float, Int

ENLARGED = 2
_LARGEST_SIDE_PX = 48.0
_LONGEST_TO_SHORTEST = 3.0
_REACH = 1.2  # of the longest side, from the quad's middle: the marker and its quiet zone
_SAME_PLACE = 0.3


def failed_places(
    quads_px: Float[np.ndarray, "q 4 2"],
    found_px: Float[np.ndarray, "m 4 2"],
    shape: tuple[int, int],
) -> Int[np.ndarray, "k 4"]:
    """Boxes x0, y0, x1, y1 around small quads that did not decode, one for each place, none where a marker was found.

    Args:
        shape: (h, w) of the image.
    """
    sides = np.linalg.norm(np.roll(quads_px, -1, axis=1) - quads_px, axis=2)
    longest, shortest = sides.max(axis=1), sides.min(axis=1)
    small = (longest < _LARGEST_SIDE_PX) & (longest < _LONGEST_TO_SHORTEST * shortest)
    found = found_px.mean(axis=1)
    kept: list[np.ndarray] = []
    boxes = []
    for row in np.flatnonzero(small):
        middle, reach = quads_px[row].mean(axis=0), _REACH * longest[row]
        near_marker = np.any(np.linalg.norm(found - middle, axis=1) < sides[row].mean())
        if near_marker or any(np.max(np.abs(middle - other)) < _SAME_PLACE * reach for other in kept):
            continue
        kept.append(middle)
        low = np.maximum(np.floor(middle - reach), 0.0)
        high = np.minimum(np.ceil(middle + reach) + 1.0, shape[::-1])
        boxes.append([*low, *high])
    return np.array(boxes, dtype=np.int64).reshape(-1, 4)


def from_enlarged(corners_px: Float[np.ndarray, "m 4 2"], x0: int, y0: int) -> Float[np.ndarray, "m 4 2"]:
    """Corners found in an enlarged box, in the image: pixel centres are at whole numbers in both."""
    return (corners_px + 0.5) / ENLARGED - 0.5 + np.array([x0, y0], dtype=np.float64)
