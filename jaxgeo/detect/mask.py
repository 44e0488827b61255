"""Masks: where the markers' colour is. OpenCV, one thread, a few calls."""

import dataclasses
import functools

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.errors import DetectError

Triple = tuple[int, int, int]

POLARITIES = ("auto", "marker", "ground")
_HUES = 180
# From the range's border to fully in or out, in units of H, S and V.
_SOFTNESS = (10.0, 60.0, 30.0)


@dataclasses.dataclass(frozen=True)
class HsvRange:
    """A box of colours in OpenCV's units: H 0 .. 179 (two degrees each), S and V 0 .. 255; both ends belong to it.

    Hue wraps round: with low H above high H the range runs through 179 and 0 (red).

    Raises:
        DetectError: values out of range; an S or V whose low end is above its high end.
    """

    low: Triple
    high: Triple

    def __post_init__(self) -> None:
        for name, end in (("low", self.low), ("high", self.high)):
            limits = (_HUES - 1, 255, 255)
            if len(end) != 3 or any(not 0 <= value <= limit for value, limit in zip(end, limits, strict=False)):
                raise DetectError(
                    f"HSV range: {name} is {tuple(end)}; expected H 0 to 179 (degrees halved), S and V 0 to 255."
                )
            object.__setattr__(self, name, tuple(int(value) for value in end))
        for axis, channel in ((1, "S"), (2, "V")):
            if self.low[axis] > self.high[axis]:
                raise DetectError(
                    f"HSV range: {channel} runs from {self.low[axis]} to {self.high[axis]}; expected the low end first "
                    "(only hue wraps round)."
                )


GREEN = HsvRange((35, 120, 50), (85, 255, 255))
RED = HsvRange((170, 120, 50), (10, 255, 255))
BLUE = HsvRange((95, 120, 50), (130, 255, 255))


@dataclasses.dataclass(frozen=True)
class MaskSettings:
    """Where a marker's reflector shows, and which part of the code it is.

    Attributes:
        hsv: the reflector's colours.
        polarity: `marker`: the code's black cells are in the range; `ground`: what lies round them is, and the lines
            are darker, so the inverted mask holds the code; `auto`: both are tried.
        open_px, close_px: side of the square of a morphological opening (removes speckle) and closing (fills holes)
            of the mask shown; 0 for none.
    """

    hsv: HsvRange = GREEN
    polarity: str = "auto"
    open_px: int = 0
    close_px: int = 0

    def __post_init__(self) -> None:
        if self.polarity not in POLARITIES:
            raise DetectError(f"polarity {self.polarity!r}; expected one of {', '.join(POLARITIES)}.")
        for name in ("open_px", "close_px"):
            if not 0 <= getattr(self, name) <= 99:
                raise DetectError(f"mask: {name} is {getattr(self, name)}; expected 0 to 99 pixels.")


def hsv_mask(bgr: UInt8[np.ndarray, "h w 3"], hsv: HsvRange) -> UInt8[np.ndarray, "h w"]:
    """255 inside the range, 0 outside."""
    image = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)
    (h0, *low), (h1, *high) = hsv.low, hsv.high
    if h0 <= h1:
        return cv2.inRange(image, hsv.low, hsv.high)
    upper = cv2.inRange(image, (h0, *low), (_HUES - 1, *high))
    return cv2.bitwise_or(upper, cv2.inRange(image, (0, *low), (h1, *high)))


def soft_mask(bgr: UInt8[np.ndarray, "h w 3"], hsv: HsvRange) -> UInt8[np.ndarray, "h w"]:
    """How far inside the range: 0 outside, 255 well inside, above 127 where `hsv_mask` is set.

    The least of three ramps, one a channel; outlines at the level 127.5 run between pixels.
    """
    ramps = cv2.LUT(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV), _ramps(hsv))
    hue, saturation, value = cv2.split(ramps)
    return cv2.min(cv2.min(hue, saturation), value)


def clean(mask: UInt8[np.ndarray, "h w"], settings: MaskSettings) -> UInt8[np.ndarray, "h w"]:
    """Opened, then closed, as the settings say."""
    for size, operation in ((settings.open_px, cv2.MORPH_OPEN), (settings.close_px, cv2.MORPH_CLOSE)):
        if size > 1:
            mask = cv2.morphologyEx(mask, operation, np.ones((size, size), np.uint8))
    return mask


@functools.cache
def _ramps(hsv: HsvRange) -> UInt8[np.ndarray, "1 256 3"]:
    level = np.arange(256.0)
    tables = []
    for channel, softness in enumerate(_SOFTNESS):
        low, high = hsv.low[channel], hsv.high[channel]
        if channel == 0:
            around = (level - low) % _HUES, (high - level) % _HUES
            width = (high - low) % _HUES
            # Steps inside the nearer end where inside; minus the steps to the nearer end where outside.
            inside = (level - low) % _HUES <= width
            depth = np.where(
                inside, np.minimum(*around) + 0.5, 0.5 - np.minimum((low - level) % _HUES, (level - high) % _HUES)
            )
            if width == _HUES - 1:
                depth = np.full(256, softness)
        else:
            # An end at the limit of the channel is no border.
            below = np.full(256, np.inf) if low == 0 else level - low + 0.5
            above = np.full(256, np.inf) if high == 255 else high - level + 0.5
            depth = np.minimum(np.minimum(below, above), softness)
        tables.append(np.clip(np.round(127.5 + 127.5 * depth / softness), 0, 255))
    return np.stack(tables, axis=-1).astype(np.uint8)[None]
