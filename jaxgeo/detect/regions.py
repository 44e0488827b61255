"""Regions of an image where decoding is worth it, from a coarse mask: a millisecond for a whole frame."""

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from jaxgeo.detect.mask import MaskSettings, hsv_mask

# Every fourth pixel of every fourth row: most of the time goes into fetching the frame, and a 20-pixel marker seen at a
# slant still has a dozen of them.
_STRIDE = 4
_CLOSING = np.ones((3, 3), np.uint8)
# Of a region's box: least pixels (coarse), least side, least share that is in the mask. Speckle has less.
_LEAST_PIXELS = 5
_LEAST_SIDE = 2
_LEAST_SHARE = 0.2
# Room around a region: for the white around the marker, and for pixels between the coarse ones.
_ROOM_SHARE, _ROOM_PIXELS = 0.2, 3
_MOST_REGIONS = 40


def find_regions(bgr: UInt8[np.ndarray, "h w 3"], settings: MaskSettings) -> Int[np.ndarray, "m 4"]:
    """Boxes x0, y0, x1, y1 (pixels, upper ends not included) that hold something in the colour range, largest first.

    At most 40: a mask of more is no mask of markers.
    """
    size = max(bgr.shape[1] // _STRIDE, 1), max(bgr.shape[0] // _STRIDE, 1)
    coarse = hsv_mask(cv2.resize(bgr, size, interpolation=cv2.INTER_NEAREST), settings.hsv)
    joined = cv2.morphologyEx(cv2.medianBlur(coarse, 3), cv2.MORPH_CLOSE, _CLOSING)
    outlines, _ = cv2.findContours(joined, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    boxes = []
    for outline in outlines:
        x, y, w, h = cv2.boundingRect(outline)
        if min(w, h) < _LEAST_SIDE or w * h < _LEAST_PIXELS:
            continue
        pixels = cv2.countNonZero(joined[y : y + h, x : x + w])
        if pixels >= max(_LEAST_PIXELS, _LEAST_SHARE * w * h):
            boxes.append((x, y, x + w, y + h))
    if not boxes:
        return np.zeros((0, 4), dtype=np.int64)
    coarse_boxes = np.array(boxes, dtype=np.int64)
    size = coarse_boxes[:, 2:] - coarse_boxes[:, :2]
    coarse_boxes = coarse_boxes[np.argsort(-size.prod(axis=1), kind="stable")][:_MOST_REGIONS]
    size = coarse_boxes[:, 2:] - coarse_boxes[:, :2]
    room = _ROOM_PIXELS + np.ceil(_ROOM_SHARE * size.max(axis=1, keepdims=True)).astype(np.int64)
    low = np.maximum((coarse_boxes[:, :2] - room) * _STRIDE, 0)
    high = np.minimum((coarse_boxes[:, 2:] + room) * _STRIDE, bgr.shape[1::-1])
    return np.concatenate([low, high], axis=1)
