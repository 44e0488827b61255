"""The compression of PCD files: LibLZF's format, unpacked.

A control byte below 32 announces that many literal bytes and one more. Any other is a copy of what was unpacked
before: its upper three bits are the length less 2 (7: the next byte is added), its lower five and the next byte the
distance less 1. A copy may reach into itself.
"""


def unpacked(data: bytes, size: int) -> bytes:
    """The `size` bytes that were packed.

    Raises:
        ValueError: the data end early, point before their beginning, or give another number of bytes.
    """
    out = bytearray()
    at = 0
    try:
        while at < len(data):
            control = data[at]
            at += 1
            if control < 32:
                literal = data[at : at + control + 1]
                if len(literal) <= control:
                    raise IndexError
                out += literal
                at += control + 1
            else:
                length = control >> 5
                if length == 7:
                    length += data[at]
                    at += 1
                length += 2
                distance = ((control & 31) << 8) + data[at] + 1
                at += 1
                if distance > len(out):
                    raise ValueError(f"byte {at} points {distance} bytes back, where there are {len(out)}")
                first = len(out) - distance
                piece = out[first : first + length]
                out += piece if distance >= length else (piece * (length // distance + 1))[:length]
            if len(out) > size:
                raise ValueError(f"more than the announced {size} bytes come out")
    except IndexError:
        raise ValueError("the packed data end in the middle of a run") from None
    if len(out) != size:
        raise ValueError(f"{len(out)} bytes come out, expected {size}")
    return bytes(out)
