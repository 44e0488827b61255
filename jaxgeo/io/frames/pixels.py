"""Encoded images (JPEG, PNG, TIFF, BMP, …) to pixels, or one clear message why not."""

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.io.frames.frame import UnreadableImageError


def decoded_image(data: bytes, source: str) -> UInt8[np.ndarray, "h w 3"]:
    """The pixels of an encoded image as BGR; 16 bits become the upper 8, grey becomes three equal channels.

    Rows and columns stay as stored: the rotation that EXIF may ask for is not applied.

    Raises:
        UnreadableImageError: it is empty, cut off, damaged, or no image.
    """
    if not len(data):
        raise UnreadableImageError(f"{source}: the image is empty. Was writing it cut off? Copy or record it again.")
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
