"""Images as RTAB-Map stores them: JPEG or PNG; depth as 16-bit PNG, as RVL, or as float32 inside of an RGBA PNG."""

import struct

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from jaxgeo.errors import ScanError
from jaxgeo.io.frames.frame import UnreadableImageError
from jaxgeo.io.frames.image_size import PNG, claimed_size
from jaxgeo.io.frames.pixels import check_claims, decoded_image
from jaxgeo.io.rtabmap.rvl import decode_rvl

MOST_PIXELS = 100_000_000
_JPEG = b"\xff\xd8\xff"
_RVL = b"DEPTHRVL"
_RVL_HEADER = 16
_MM = 0.001
_NOTHING = np.iinfo(np.uint16).max  # the largest number marks pixels without depth, as 0 does


def image_suffix(data: bytes, place: str) -> str:
    """`.jpg`, `.png` or `.rvl`, by the first bytes.

    Raises:
        ScanError: another format.
    """
    for magic, suffix in ((_JPEG, ".jpg"), (PNG, ".png"), (_RVL, ".rvl")):
        if data.startswith(magic):
            return suffix
    raise ScanError(
        f"{place}: {len(data)} bytes, beginning with {data[:8].hex(' ')}; expected a JPEG, PNG or RVL image. Is the "
        "value damaged?"
    )


def image_size(data: bytes, place: str) -> tuple[int, int]:
    """(width, height) as the head of the image announces them: nothing is decoded.

    Raises:
        ScanError: no JPEG, PNG or RVL image, cut off in its head, or of no or too many pixels.
    """
    suffix = image_suffix(data, place)
    size = _rvl_size(data) if suffix == ".rvl" else claimed_size(data)
    if size is None:
        raise ScanError(f"{place}: the {suffix[1:]} image of {len(data)} bytes ends within its head. Is it cut off?")
    if not 0 < size[0] * size[1] <= MOST_PIXELS:
        raise ScanError(
            f"{place}: the image announces {size[0]} x {size[1]} pixels; expected 1 to {MOST_PIXELS}. Is it damaged?"
        )
    return size


def colour_image(data: bytes, place: str) -> UInt8[np.ndarray, "h w 3"]:
    """The pixels as BGR; grey becomes three equal channels.

    Raises:
        ScanError: as `image_size`, or the image cannot be decoded.
    """
    size = image_size(data, place)
    if image_suffix(data, place) == ".rvl":
        raise ScanError(f"{place}: a colour image coded as RVL, which is for depth only. Is the value damaged?")
    try:
        image = decoded_image(data, place)
    except UnreadableImageError as failure:
        raise ScanError(str(failure)) from None
    _check_decoded(image, size, place)
    return image


def depth_image_m(data: bytes, place: str) -> Float[np.ndarray, "h w"] | None:
    """Depth in metres, float32, 0 where there is none; None where the value is the right image of a stereo camera.

    16 bits are millimetres; four bytes a pixel are one float32 in metres.

    Raises:
        ScanError: as `image_size`, or the image cannot be decoded or is of another kind.
    """
    size = image_size(data, place)
    suffix = image_suffix(data, place)
    if suffix == ".jpg":
        return None
    if suffix == ".rvl":
        try:
            stored = decode_rvl(data[_RVL_HEADER:], size[0] * size[1]).reshape(size[1], size[0])
        except ValueError as failure:
            raise ScanError(f"{place}: the RVL depth is damaged: {failure}.") from None
    else:
        stored = _decoded(data, place)
        _check_decoded(stored, size, place)
    if stored.dtype == np.uint16 and stored.ndim == 2:
        return np.where(stored == _NOTHING, 0, stored) * np.float32(_MM)
    if stored.dtype == np.uint8 and stored.shape[2:] == (4,):
        depth_m = np.ascontiguousarray(stored).view("<f4")[:, :, 0]
        return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.float32(0))
    if stored.dtype == np.uint8:
        return None
    raise ScanError(f"{place}: depth of {stored.dtype} {stored.shape}; expected 16 bits in mm, or float32 as RGBA.")


def depth_mm(depth_m: Float[np.ndarray, "h w"]) -> tuple[np.ndarray, int]:
    """Depth as 16 bits in millimetres, and how many pixels are too far for them (65.535 m): these become 0."""
    rounded = np.rint(depth_m / np.float32(_MM))
    far = rounded >= _NOTHING
    return np.where(far, 0, rounded).astype(np.uint16), int(far.sum())


def _decoded(data: bytes, place: str) -> np.ndarray:
    try:
        check_claims(data, place)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except UnreadableImageError as failure:
        raise ScanError(str(failure)) from None
    except cv2.error:
        image = None
    if image is None:
        raise ScanError(f"{place}: the image of {len(data)} bytes cannot be decoded. Is it cut off or damaged?")
    return image


def _check_decoded(image: np.ndarray, size: tuple[int, int], place: str) -> None:
    height, width = image.shape[:2]
    if (width, height) != size:
        raise ScanError(f"{place}: the head announces {size[0]} x {size[1]} pixels, {width} x {height} were decoded.")


def _rvl_size(data: bytes) -> tuple[int, int] | None:
    return struct.unpack("<II", data[8:16]) if len(data) >= _RVL_HEADER else None
