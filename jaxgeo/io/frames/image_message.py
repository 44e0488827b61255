"""The pixels of ROS image messages: sensor_msgs/Image and sensor_msgs/CompressedImage."""

from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.io.frames.frame import UnreadableImageError
from jaxgeo.io.frames.pixels import decoded_image

# encoding -> (channels, bytes per channel, OpenCV's conversion to BGR; None: it is BGR)
ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, 1, cv2.COLOR_GRAY2BGR),
    "mono16": (1, 2, cv2.COLOR_GRAY2BGR),
    "bgr8": (3, 1, None),
    "8UC3": (3, 1, None),
    "bgr16": (3, 2, None),
    "rgb8": (3, 1, cv2.COLOR_RGB2BGR),
    "rgb16": (3, 2, cv2.COLOR_RGB2BGR),
    "bgra8": (4, 1, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, 1, cv2.COLOR_RGBA2BGR),
    **{
        f"bayer_{pattern}{bits}": (1, bits // 8, conversion)
        for bits in (8, 16)
        for pattern, conversion in (
            ("rggb", cv2.COLOR_BayerRGGB2BGR),
            ("bggr", cv2.COLOR_BayerBGGR2BGR),
            ("gbrg", cv2.COLOR_BayerGBRG2BGR),
            ("grbg", cv2.COLOR_BayerGRBG2BGR),
        )
    },
    "yuv422": (2, 1, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, 1, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, 1, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": (2, 1, cv2.COLOR_YUV2BGR_YUYV),
}


def image_of_message(message: Any, source: str) -> UInt8[np.ndarray, "h w 3"]:
    """BGR pixels of a sensor_msgs/Image; of 16 bits the upper 8. Rows may be padded (`step`).

    Raises:
        UnreadableImageError: the encoding is not one of `ENCODINGS`, 16 bits are big endian, or the data are too few.
    """
    if message.encoding not in ENCODINGS:
        raise UnreadableImageError(
            f"{source}: encoding {message.encoding!r}, expected one of {', '.join(ENCODINGS)}. Is this a topic of "
            "depth images? Name one of colour or grey images."
        )
    channels, size, conversion = ENCODINGS[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * size
    if height == 0 or width == 0 or step < row or len(message.data) < step * (height - 1) + row:
        raise UnreadableImageError(
            f"{source}: {len(message.data)} bytes in rows of {step}, expected {height} rows of at least {row} bytes "
            f"({width} pixels of {message.encoding}). The message is damaged, or its driver fills it wrongly."
        )
    if size == 2 and message.is_bigendian:
        raise UnreadableImageError(
            f"{source}: {message.encoding} in big-endian order, expected little endian. Record it again, or convert "
            "the topic."
        )
    # The last row need not be padded: strides see the rows without a copy
    pixels = np.ndarray((height, row), np.uint8, np.ascontiguousarray(message.data, np.uint8), strides=(step, 1))
    if size == 2:
        pixels = pixels[:, 1::2]
    pixels = np.ascontiguousarray(pixels.reshape(height, width, channels))
    if conversion is None:
        return pixels.copy()  # the message's own memory is read-only
    try:
        return cv2.cvtColor(pixels, conversion)
    except cv2.error:  # 4:2:2 of an odd width, Bayer of one row
        raise UnreadableImageError(
            f"{source}: {width}×{height} pixels cannot be of encoding {message.encoding}. The message is damaged."
        ) from None


def image_of_compressed_message(message: Any, source: str) -> UInt8[np.ndarray, "h w 3"]:
    """BGR pixels of a sensor_msgs/CompressedImage: JPEG, PNG or whatever else OpenCV decodes.

    The format may say `rgb8; jpeg compressed bgr8`: what was the camera's, and in which order the channels lie in the
    compressed image. Where that is RGB, red and blue are exchanged.

    Raises:
        UnreadableImageError: they are depth images, a raw Bayer pattern, or not an image.
    """
    _, _, stored = message.format.lower().partition("compressed")
    if "compresseddepth" in message.format.lower() or stored.strip().startswith("bayer"):
        raise UnreadableImageError(
            f"{source}: a compressed image of format {message.format!r}, expected JPEG or PNG in colours or grey. "
            "Name another topic."
        )
    image = decoded_image(bytes(message.data), f"{source} (format {message.format!r})")
    return cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if stored.strip().startswith("rgb") else image
