"""The binary values of RTAB-Map's tables: plain arrays, and arrays compressed with zlib; little-endian all.

A compressed value is a zlib stream of an OpenCV matrix, followed by three int32: rows, columns and OpenCV's type (depth
in the lowest three bits, channels less one above them).
"""

import struct
import zlib
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import InputError

LARGEST_ARRAY_BYTES = 1 << 28
_DEPTHS = ("u1", "i1", "<u2", "<i2", "<i4", "<f4", "<f8")
_TRAILER = struct.Struct("<3i")


def blob(value: Any, place: str) -> bytes | None:
    """The bytes of a column's value; None where it is NULL or empty.

    Raises:
        InputError: it is text or a number.
    """
    if value is None:
        return None
    if not isinstance(value, bytes):
        raise InputError(f"{place}: holds {type(value).__name__} {str(value)[:40]!r}, expected binary data (a BLOB).")
    return value or None


def pose_blob(value: Any, place: str) -> Float[np.ndarray, "3 4"] | None:
    """The pose in 12 float32, rows of [R | t]; None where there is none: NULL, or RTAB-Map's null pose, all zeros.

    Raises:
        InputError: no BLOB, or not of 48 bytes.
    """
    data = blob(value, place)
    if data is None:
        return None
    pose = numbers(data, "<f4", 12, place).reshape(3, 4)
    return pose if pose.any() else None


def numbers(data: bytes, dtype: str, count: int, place: str) -> Float[np.ndarray, "count"]:
    """That many numbers, as float64.

    Raises:
        InputError: another number of bytes.
    """
    expected = count * np.dtype(dtype).itemsize
    if len(data) != expected:
        raise InputError(f"{place}: {len(data)} bytes, expected {expected} ({count} numbers). Is the value cut off?")
    with np.errstate(invalid="ignore"):  # NaN of the signalling kind
        return np.frombuffer(data, dtype).astype(np.float64)


def compressed_array(data: bytes, place: str) -> np.ndarray:
    """The matrix of a compressed value: (rows, columns), or (rows, columns, channels) where there are several.

    Raises:
        InputError: cut off, no zlib stream, a size that is not what the trailer announces, or too large.
    """
    if len(data) <= _TRAILER.size:
        raise InputError(f"{place}: {len(data)} bytes, too few for a compressed matrix. Is the value cut off?")
    rows, columns, kind = _TRAILER.unpack(data[-_TRAILER.size :])
    depth, channels = kind & 7, (kind >> 3) + 1
    if rows < 0 or columns < 0 or kind < 0 or depth >= len(_DEPTHS) or channels > 512:
        raise InputError(
            f"{place}: announces a matrix of {rows} x {columns}, OpenCV type {kind}, which there is not. Is the value "
            "cut off, or of another format?"
        )
    dtype = np.dtype(_DEPTHS[depth])
    size = rows * columns * channels * dtype.itemsize
    if size > LARGEST_ARRAY_BYTES:
        raise InputError(
            f"{place}: announces a matrix of {rows} x {columns} x {channels}, {size} bytes; expected at most "
            f"{LARGEST_ARRAY_BYTES}. Is the value damaged?"
        )
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(data[: -_TRAILER.size], size + 1)  # a byte more than announced is enough to refuse
    except zlib.error as failure:
        raise InputError(f"{place}: is no zlib stream: {failure}. Is the value damaged?") from None
    if len(content) != size or not (stream.eof or size == 0):
        more = "more" if len(content) > size else f"{len(content)}"
        raise InputError(f"{place}: announces {size} bytes and holds {more}. Is the value cut off or damaged?")
    array = np.frombuffer(content, dtype)
    return array.reshape((rows, columns) if channels == 1 else (rows, columns, channels))
