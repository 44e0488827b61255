"""What two views through different polarisers do not share: the reflector alone.

Cholesteric reflectors return circularly polarised light of one handedness, everything else (nearly) as much of one as
of the other. So of two images, through a left-handed and a right-handed polariser, or with and without one, the rest
cancels and the reflector remains, whatever the colour of the background. Two cameras see the same plane through a
homography; one camera that switches its polariser sees it at two times.

Method of the iMarker sensors: Tourani et al., "Unveiling the Potential of iMarkers", arXiv 2501.15505.
"""

import dataclasses
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from jaxgeo.errors import DetectError

# Pixels near black or white say nothing of the gain; fewer than this share of the rest is no measurement of it.
_DARK, _BRIGHT = 8.0, 247.0
_LEAST_SHARE = 0.01


@dataclasses.dataclass(frozen=True)
class SubtractionSettings:
    """How a difference of two images becomes a mask.

    Attributes:
        blur_px: sigma of the Gaussian that smooths the difference; 0 for none.
        threshold: gray levels of difference above which a pixel is reflector; None to choose it for each pair (Otsu).
        least_levels: with Otsu, no threshold below this one: two views without a reflector differ by noise alone, which
            Otsu would part in two all the same.

    Raises:
        DetectError: a value out of its range.
    """

    blur_px: float = 1.0
    threshold: float | None = None
    least_levels: float = 12.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.blur_px <= 50.0:
            raise DetectError(f"subtraction: blur_px is {self.blur_px}; expected 0 to 50 pixels.")
        for name in ("threshold", "least_levels"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < 255.0:
                raise DetectError(f"subtraction: {name} is {value}; expected 0 to 255 gray levels, 255 not included.")


class Subtracted(NamedTuple):
    """What two images do not share.

    Attributes:
        difference: absolute gray levels, blurred, rounded; 0 where the second camera does not look.
        mask: 255 where it is above the threshold.
        threshold: the one used, gray levels.
        gain: by which the second image was multiplied to match the first.
    """

    difference: UInt8[np.ndarray, "h w"]
    mask: UInt8[np.ndarray, "h w"]
    threshold: float
    gain: float


def subtract_in_time(
    first: UInt8[np.ndarray, "h w ..."],
    second: UInt8[np.ndarray, "h w ..."],
    settings: SubtractionSettings = SubtractionSettings(),
) -> Subtracted:
    """One resting camera, two polariser states.

    Args:
        first, second: BGR or gray, of one size.

    Raises:
        DetectError: images of different sizes or other kinds; all black or all white.
    """
    a, b = _gray(first, "first"), _gray(second, "second")
    if a.shape != b.shape:
        raise DetectError(f"subtraction: images of {_size(a)} and {_size(b)} pixels; expected one camera's.")
    return _subtracted(a, b, np.ones(a.shape, dtype=bool), settings)


def subtract_cameras(
    left: UInt8[np.ndarray, "h w ..."],
    right: UInt8[np.ndarray, "k l ..."],
    H_left_right: Float[np.ndarray, "3 3"],
    settings: SubtractionSettings = SubtractionSettings(),
) -> Subtracted:
    """Two cameras behind polarisers of opposite handedness, compared in the left camera's pixels.

    Args:
        left, right: BGR or gray.
        H_left_right: homography that maps homogeneous pixels (x, y, 1) of the right image to those of the left one,
            pixel centres at whole numbers; it holds for the plane or the distance that it was measured at.

    Raises:
        DetectError: a homography that is not 3 x 3, not finite or singular, or under which the images do not overlap;
            images of other kinds; all black or all white.
    """
    a, b = _gray(left, "left"), _gray(right, "right")
    H = np.asarray(H_left_right, dtype=np.float64)
    if H.shape != (3, 3) or not np.isfinite(H).all() or np.linalg.matrix_rank(H) < 3:
        raise DetectError(f"subtraction: homography {H.tolist()}; expected 3 x 3 finite numbers, not singular.")
    size = a.shape[::-1]
    warped = cv2.warpPerspective(b, H, size, flags=cv2.INTER_LINEAR)
    # One only where all four neighbours that were mixed are the right camera's.
    seen = cv2.warpPerspective(np.ones_like(b), H, size, flags=cv2.INTER_LINEAR) > 0.999
    if not seen.any():
        raise DetectError(
            f"subtraction: under this homography no pixel of the right image ({_size(b)}) falls into the left one "
            f"({_size(a)}); expected H_left_right, right to left: perhaps its inverse is given."
        )
    return _subtracted(a, warped, seen, settings)


def _subtracted(
    a: Float32[np.ndarray, "h w"],
    b: Float32[np.ndarray, "h w"],
    seen: Bool[np.ndarray, "h w"],
    settings: SubtractionSettings,
) -> Subtracted:
    gain = _gain(a, b, seen)
    # Both cut at the lower of the two ceilings: where one image is saturated the other's surplus is no difference.
    ceiling = np.float32(255.0 * min(1.0, gain))
    apart = np.abs(np.minimum(a, ceiling) - np.minimum(np.float32(gain) * b, ceiling))
    apart[~seen] = 0.0
    if settings.blur_px > 0.0:
        apart = cv2.GaussianBlur(apart, (0, 0), settings.blur_px)
        apart[~seen] = 0.0
    difference = np.clip(np.rint(apart), 0, 255).astype(np.uint8)
    if settings.threshold is not None:
        level = float(settings.threshold)
    else:
        otsu, _ = cv2.threshold(difference[seen], 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
        level = max(float(otsu), settings.least_levels)
    return Subtracted(difference, (difference > level).astype(np.uint8) * 255, level, gain)


def _gain(a: Float32[np.ndarray, "h w"], b: Float32[np.ndarray, "h w"], seen: Bool[np.ndarray, "h w"]) -> float:
    """Median of a / b over well exposed pixels: the reflector, whose ratio is another, is a minority."""
    usable = (a > _DARK) & (a < _BRIGHT) & (b > _DARK) & (b < _BRIGHT)
    if np.count_nonzero(usable) < _LEAST_SHARE * np.count_nonzero(seen):
        raise DetectError(
            "subtraction: fewer than 1 % of the pixels are well exposed (gray levels 8 to 247) in both images, so "
            "their brightness cannot be matched; expected two ordinary exposures of one scene."
        )
    return float(np.median(a[usable] / b[usable]))


def _gray(image: UInt8[np.ndarray, "h w ..."], name: str) -> Float32[np.ndarray, "h w"]:
    colour = image.ndim == 3 and image.shape[2] == 3
    if image.dtype != np.uint8 or not (image.ndim == 2 or colour) or image.size == 0:
        raise DetectError(
            f"subtraction: the {name} image has shape {image.shape} and type {image.dtype}; expected bytes, (h, w) "
            "gray or (h, w, 3) BGR."
        )
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if colour else image
    return gray.astype(np.float32)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"
