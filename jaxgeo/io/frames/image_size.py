"""What an encoded image claims, its pixels and its bytes: read before memory is asked for as many.

PNG: the IHDR chunk comes first (W3C PNG, 11.2.2). JPEG: the frame header, SOF0 to SOF15 without DHT, JPG and DAC (ITU-T
T.81, B.2.2). BMP: the BITMAPINFOHEADER. TIFF: tags 256 and 257 of the first directory (TIFF 6.0).
"""

import struct

PNG = b"\x89PNG\r\n\x1a\n"
MOST_PIXELS = 1 << 28  # above the largest cameras' 150 megapixels
_NO_FRAMES = (0xC4, 0xC8, 0xCC)
_TIFF_SIZE = {256: 0, 257: 1}


def claimed_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) of a PNG, JPEG, BMP or TIFF; None of other formats, and where the head is cut off or damaged."""
    try:
        if data.startswith(PNG):
            return struct.unpack_from(">2I", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _of_jpeg(data)
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<2i", data, 18)
            return abs(width), abs(height)
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _of_tiff(data)
    except struct.error:
        return None
    return None


def missing_bytes(data: bytes) -> int:
    """Bytes that a PNG lacks by the lengths of its chunks: decoders ask for that memory first. 0 of other formats."""
    if not data.startswith(PNG):
        return 0
    at = len(PNG)
    while at + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        at += 12 + length  # length, kind and checksum beside the content
        if kind == b"IEND":
            break
    return max(at - len(data), 0)


def _of_jpeg(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in _NO_FRAMES:
            height, width = struct.unpack_from(">2H", data, at + 5)
            return width, height
        if marker == 0xFF:  # fill
            at += 1
        elif 0xD0 <= marker <= 0xD8:  # no length
            at += 2
        else:
            at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    return None


def _of_tiff(data: bytes) -> tuple[int, int] | None:
    order = "<" if data.startswith(b"II") else ">"
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    size: list[int | None] = [None, None]
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(f"{order}2H", data, entry)
        if tag in _TIFF_SIZE:
            (size[_TIFF_SIZE[tag]],) = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", data, entry + 8)
    width, height = size
    return None if width is None or height is None else (width, height)
