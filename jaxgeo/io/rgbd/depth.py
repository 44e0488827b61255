"""Depth images to metres."""

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32

from jaxgeo.errors import ScanError
from jaxgeo.io.frames.pixels import check_claims
from jaxgeo.io.item_source import raised_as
from jaxgeo.io.regular_file import read_whole
from jaxgeo.io.rgbd.rgbd_source import UnreadableFrameError

NO_DEPTH = 65535  # what 7-Scenes writes, besides 0; at 1 mm a step it would be 65.5 m
LARGEST_UNIT_M = 0.1
_DEPTH_HEADER = 12  # of compressed_depth_image_transport: an enumeration and two float32
_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}


def check_depth_unit(path: str | Path, depth_unit_m: float) -> None:
    """Refuse a unit that no depth camera has.

    Raises:
        ScanError: not positive, or above 0.1 m.
    """
    if not (math.isfinite(depth_unit_m) and 0 < depth_unit_m <= LARGEST_UNIT_M):
        raise ScanError(
            f"{path}: depth_unit_m is {depth_unit_m}, expected the metres of one step of a 16-bit depth image, above 0 "
            f"and at most {LARGEST_UNIT_M:g}: 0.001 for millimetres, 0.0002 for the factor 5000 of TUM RGB-D."
        )


def depth_of_file(path: Path, depth_unit_m: float) -> Float32[np.ndarray, "h w"]:
    """Depth of a PNG, TIFF or PGM of 16 bits (steps of `depth_unit_m`) or of floats (metres).

    Raises:
        UnreadableFrameError: no such file, not an image, or not a depth image.
    """
    try:
        data = read_whole(path, UnreadableFrameError)
    except FileNotFoundError:
        raise UnreadableFrameError(f"{path}: no such file. Was it moved or not copied?") from None
    except OSError as failure:
        raise UnreadableFrameError(f"{path}: cannot be read: {failure.strerror}.") from None
    return metres(_decoded(data, str(path)), depth_unit_m, str(path))


def depth_of_message(message: Any, depth_unit_m: float, source: str) -> Float32[np.ndarray, "h w"]:
    """Depth of a sensor_msgs/Image: 16UC1 in steps of `depth_unit_m`, 32FC1 in metres.

    Raises:
        UnreadableFrameError: another encoding, or too few data.
    """
    if message.encoding not in _ENCODINGS:
        raise UnreadableFrameError(
            f"{source}: encoding {message.encoding!r}, expected depth: {', '.join(_ENCODINGS)}. Name the topic of "
            "depth images."
        )
    dtype = np.dtype((">" if message.is_bigendian else "<") + _ENCODINGS[message.encoding])
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * dtype.itemsize
    if height == 0 or width == 0 or step < row or len(message.data) < step * (height - 1) + row:
        raise UnreadableFrameError(
            f"{source}: {len(message.data)} bytes in rows of {step}, expected {height} rows of at least {row} bytes "
            f"({width} pixels of {message.encoding}). The message is damaged, or its driver fills it wrongly."
        )
    data = np.ascontiguousarray(message.data, np.uint8)
    return metres(np.ndarray((height, width), dtype, data, strides=(step, dtype.itemsize)), depth_unit_m, source)


def depth_of_compressed_message(message: Any, depth_unit_m: float, source: str) -> Float32[np.ndarray, "h w"]:
    """Depth of a sensor_msgs/CompressedImage: a PNG of 16 bits, or what compressed_depth_image_transport writes.

    That puts 12 bytes before the PNG: an enumeration and two float32 a, b, with which 32FC1 was quantised as
    inverse depth, d = a / (q - b).

    Raises:
        UnreadableFrameError: not a depth image.
    """
    kind = message.format.lower()
    data = bytes(message.data)
    transported = "compresseddepth" in kind
    raw = _decoded(data[_DEPTH_HEADER:] if transported else data, f"{source} (format {message.format!r})")
    if not (transported and kind.startswith("32fc1")):
        return metres(raw, depth_unit_m, source)
    a, b = np.frombuffer(data, "<f4", 2, 4)
    with np.errstate(divide="ignore"):
        return metres(np.where(raw == 0, np.float32(0), a / (raw.astype(np.float32) - b)), depth_unit_m, source)


def metres(raw: np.ndarray, depth_unit_m: float, source: str) -> Float32[np.ndarray, "h w"]:
    """Steps (16 bits) or metres (floats) to float32 metres; 0 where there is none.

    None is 0, `NO_DEPTH`, not finite or negative.

    Raises:
        UnreadableFrameError: other pixels than these.
    """
    if raw.ndim != 2 or not (raw.dtype.kind == "f" or (raw.dtype.kind == "u" and raw.dtype.itemsize == 2)):
        channels = raw.shape[2] if raw.ndim == 3 else 1
        raise UnreadableFrameError(
            f"{source}: {channels} channels of {raw.dtype}, expected one of uint16 or floats. Is it a picture of depth "
            "(8 bits, coloured) rather than the depth itself?"
        )
    if raw.dtype.kind == "f":
        return np.where(np.isfinite(raw) & (raw > 0), raw, 0).astype(np.float32)
    return np.where(raw == NO_DEPTH, 0, raw * np.float64(depth_unit_m)).astype(np.float32)


def _decoded(data: bytes, source: str) -> np.ndarray:
    with raised_as(UnreadableFrameError):
        check_claims(data, source)
    try:
        raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        raw = None
    if raw is None:
        raise UnreadableFrameError(
            f"{source}: {len(data)} bytes, beginning with {data[:8].hex(' ')}, are no depth image that OpenCV can "
            "decode. Is it cut off? Copy it again, or save it as PNG of 16 bits."
        )
    return raw
