"""What tuning a colour range has changed: images, labels and masks before and after."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.detect.mask import HsvRange, hsv_mask
from jaxgeo.detect.tune import LabelledFrame, Tuned
from jaxgeo.export.image_drawing import PAPER, draw_line_of_text

_PANEL_WIDTH_PX = 420
_WORDS_PX = 12.0
_ROOM_PX = 30
_TINT = np.array([220.0, 60.0, 220.0])
_MOST_ROWS = 8


def tuned_picture(frames: Sequence[LabelledFrame], start: HsvRange, tuned: Tuned) -> UInt8[np.ndarray, "h w 3"]:
    """Rows of image with its label outlined, mask before, mask after (magenta over the image), BGR; at most 8 rows."""
    rows = []
    for frame in frames[:_MOST_ROWS]:
        before, after = tuned.frame_iou[frame.name]
        outlined = frame.bgr.copy()
        edges, _ = cv2.findContours(frame.label.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(outlined, edges, -1, (0, 230, 255), max(1, frame.bgr.shape[1] // 400))
        panels = (
            (f"{frame.name}: label", outlined),
            (f"before: overlap {100 * before:.0f} %", _tinted(frame.bgr, start)),
            (f"after: overlap {100 * after:.0f} %", _tinted(frame.bgr, tuned.hsv)),
        )
        rows.append(np.hstack([_panel(words, picture) for words, picture in panels]))
    return np.vstack(rows)


def _tinted(bgr: UInt8[np.ndarray, "h w 3"], hsv: HsvRange) -> UInt8[np.ndarray, "h w 3"]:
    inside = hsv_mask(bgr, hsv) > 0
    picture = bgr.astype(np.float64)
    picture[inside] = 0.3 * picture[inside] + 0.7 * _TINT
    return picture.astype(np.uint8)


def _panel(words: str, picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    scale = _PANEL_WIDTH_PX / picture.shape[1]
    size = (_PANEL_WIDTH_PX, max(1, round(picture.shape[0] * scale)))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
    panel = np.full((size[1] + _ROOM_PX, size[0] + 6, 3), PAPER, np.uint8)
    panel[_ROOM_PX:, :-6] = small
    draw_line_of_text(panel, words, 4, _ROOM_PX - 9, _WORDS_PX)
    return panel
