"""Many images of a recording on one page, each with what was decoded in it."""

from collections.abc import Sequence

import cv2
import equinox as eqx
import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.export.image_drawing import INK, PAPER, as_bgr, draw_line_of_text, draw_markers, fitting

_GAP_PX = 8
_WORDS_PX = 11.0


class SheetImage(eqx.Module):
    """One image of the sheet.

    Attributes:
        image: BGR or gray.
        label: its stamp and camera.
        corners_px: (m, 4, 2) of the markers in it, pixels of `image`.
        names: (m,) what is written at them.
    """

    image: UInt8[np.ndarray, "h w ..."]
    label: str
    corners_px: Float[np.ndarray, "m 4 2"]
    names: Sequence[str]


def thumbnail(shown: SheetImage, width_px: int) -> SheetImage:
    """The same, smaller: what is kept of each image until the sheet is drawn."""
    height, width = shown.image.shape[:2]
    scale = width_px / width
    small = cv2.resize(
        as_bgr(shown.image),
        (width_px, max(1, round(height * scale))),
        interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR,
    )
    return SheetImage(small, shown.label, (shown.corners_px + 0.5) * scale - 0.5, shown.names)


def contact_sheet(
    images: Sequence[SheetImage], title: str, *, columns: int = 4, width_px: int = 400
) -> UInt8[np.ndarray, "a b 3"]:
    """Images row by row as thumbnails `width_px` wide, their labels above them, names drawn after the scaling, BGR.

    Raises:
        ValueError: no image.
    """
    if not images:
        raise ValueError("a contact sheet of no images")
    small = [thumbnail(image, width_px) for image in images]
    columns = min(columns, len(small))
    strip = round(2.2 * _WORDS_PX)
    rows = [small[k : k + columns] for k in range(0, len(small), columns)]
    page_width = columns * (width_px + _GAP_PX) + _GAP_PX
    page = [_strip(title, page_width, 1.4 * _WORDS_PX)]
    for row in rows:
        height = max(one.image.shape[0] for one in row) + strip + _GAP_PX
        band = np.full((height, page_width, 3), PAPER, np.uint8)
        for k, one in enumerate(row):
            left = _GAP_PX + k * (width_px + _GAP_PX)
            label = fitting(one.label, width_px, _WORDS_PX)
            draw_line_of_text(band, label, left, round(1.6 * _WORDS_PX), _WORDS_PX, INK)
            draw_markers(one.image, one.corners_px, one.names, _WORDS_PX)
            band[strip : strip + one.image.shape[0], left : left + width_px] = one.image
        page.append(band)
    return np.concatenate(page)


def _strip(title: str, width_px: int, words_px: float) -> UInt8[np.ndarray, "a b 3"]:
    band = np.full((round(2.4 * words_px), width_px, 3), PAPER, np.uint8)
    draw_line_of_text(band, fitting(title, width_px - 2 * _GAP_PX, words_px), _GAP_PX, round(1.7 * words_px), words_px)
    return band
