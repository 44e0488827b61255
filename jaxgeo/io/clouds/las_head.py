"""What the head of a LAS file announces, checked before laspy believes it.

laspy reads as many records as the head says, whether they are there or not: four thousand million take hours and all
memory. Layout: ASPRS, "LAS specification 1.4 - R15", table 3.
"""

import struct
from pathlib import Path

_MAGIC = b"LASF"
_SMALLEST_HEAD, _RECORD, _EXTENDED_RECORD = 227, 54, 60  # bytes: of the head of 1.0 to 1.2, of the records' own heads
_SIZES = struct.Struct("<HII")  # of the head, offset to the points, number of records
_SIZES_AT = 94
_EXTENDED = struct.Struct("<QI")  # of version 1.4: where the records behind the points start, and their number
_EXTENDED_AT = 235


def las_problem(path: str | Path) -> str | None:
    """What is wrong with the head of a LAS or LAZ file; None where nothing is.

    Raises:
        OSError: the file cannot be read.
    """
    size = Path(path).stat().st_size
    with Path(path).open("rb") as file:
        head = file.read(_EXTENDED_AT + _EXTENDED.size)
    if head[:4] != _MAGIC:
        return f"it begins with {head[:4]!r}, expected {_MAGIC!r}"
    if len(head) < _SMALLEST_HEAD:
        return f"it ends within its head, at byte {len(head)}"
    head_size, points_at, n_records = _SIZES.unpack_from(head, _SIZES_AT)
    if not _SMALLEST_HEAD <= head_size <= points_at <= size:
        return f"a head of {head_size} bytes, and points from byte {points_at} of {size}"
    if n_records * _RECORD > points_at - head_size:
        return f"{n_records} records in the {points_at - head_size} bytes before its points"
    if head[25] >= 4 and len(head) == _EXTENDED_AT + _EXTENDED.size:
        start, n_extended = _EXTENDED.unpack_from(head, _EXTENDED_AT)
        if n_extended and (start > size or n_extended * _EXTENDED_RECORD > size - start):
            return f"{n_extended} records from byte {start} of {size}"
    return None
