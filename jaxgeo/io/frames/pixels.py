"""Encoded images (JPEG, PNG, TIFF, BMP, …) to pixels, or one clear message why not."""

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.io.frames.frame import UnreadableImageError
from jaxgeo.io.frames.image_size import MOST_PIXELS, claimed_size, missing_bytes


def decoded_image(data: bytes, source: str) -> UInt8[np.ndarray, "h w 3"]:
    """The pixels of an encoded image as BGR; 16 bits become the upper 8, grey becomes three equal channels.

    Rows and columns stay as stored: the rotation that EXIF may ask for is not applied.

    Raises:
        UnreadableImageError: it is empty, cut off, damaged, too large, or no image.
    """
    if not len(data):
        raise UnreadableImageError(f"{source}: the image is empty. Was writing it cut off? Copy or record it again.")
    check_claims(data, source)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        image = None
    if image is None:
        raise UnreadableImageError(
            f"{source}: {len(data)} bytes, beginning with {bytes(data[:8]).hex(' ')}, are no image that OpenCV can "
            "decode. Is it cut off, or of another format than its name says? Copy it again, or save it as PNG or JPEG."
        )
    return image


def check_claims(data: bytes, source: str) -> None:
    """Refuse an image that claims more than there can be: a small file can be made to fill the memory.

    Raises:
        UnreadableImageError: more pixels than a camera takes, or a part that is longer than the file; with the size.
    """
    size = claimed_size(data)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise UnreadableImageError(
            f"{source}: claims {size[0]} x {size[1]} pixels, expected at most {MOST_PIXELS:,} in all. Is it "
            "damaged, or made to fill the memory?"
        )
    missing = missing_bytes(data)
    if missing > 0:
        raise UnreadableImageError(
            f"{source}: {len(data)} bytes, of which the last part claims {missing} more. Was writing it cut off? Copy "
            "it again."
        )
