"""What LAZ says of its compression, checked before the decompressor believes it.

lazrs asks for memory by these numbers, and ends the whole process where there is none: a damaged file must not come so
far. Layout: Isenburg, "LASzip: lossless compression of LiDAR data" (2013), and the source of LASzip.
"""

import importlib
import struct
from pathlib import Path
from typing import Any

_ITEMS_AT = 32
_VARIABLE = 0xFFFFFFFF
_MOST_POINTS = 10_000_000  # in a chunk: LASzip's default is 50 000, and a decompressor holds a whole one


def laszip_problem(path: str | Path, header: Any) -> str | None:
    """What is wrong with the compression's record or its table of chunks; None where nothing is.

    Raises whatever lazrs does on a table that cannot be decoded.

    Args:
        header: laspy's, of a compressed file.
    """
    try:
        record = header.vlrs.get("LasZipVlr")[0].record_data
        (chunk_size,) = struct.unpack_from("<I", record, 12)
        (n_items,) = struct.unpack_from("<H", record, _ITEMS_AT)
        sizes = [struct.unpack_from("<3H", record, _ITEMS_AT + 2 + 6 * i)[1] for i in range(n_items)]
    except (IndexError, struct.error):
        return "the record of its compression is missing or too short"
    if sum(sizes) != header.point_format.size:
        return f"its compressed points have {sum(sizes)} bytes, its format {header.point_format.size}"
    if chunk_size != _VARIABLE and not 0 < chunk_size <= max(_MOST_POINTS, header.point_count):
        return f"its chunks would hold {chunk_size} points each"
    return _table_problem(path, header, chunk_size, record)


def _table_problem(path: str | Path, header: Any, chunk_size: int, record: bytes) -> str | None:
    lazrs: Any = importlib.import_module("lazrs")  # what laspy decompresses with

    start, size = header.offset_to_point_data, Path(path).stat().st_size
    with Path(path).open("rb") as file:
        file.seek(start)
        (at,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
        if at == -1 and size >= 8:  # written to what could not be rewound: the place stands at the end
            file.seek(size - 8)
            (at,) = struct.unpack("<q", file.read(8))
        if not start + 8 <= at <= size - 8:
            return f"its table of chunks would lie at byte {at} of {size}"
        file.seek(at)
        version, n_chunks = struct.unpack("<2I", file.read(8))
        most = header.point_count if chunk_size == _VARIABLE else -(-header.point_count // chunk_size)
        if version != 0 or n_chunks > most:
            return f"its table has {n_chunks} chunks for {header.point_count} points"
        file.seek(at)
        chunks = lazrs.read_chunk_table_only(file, lazrs.LazVlr(record))
    n_bytes = sum(each for _, each in chunks)
    if n_bytes != at - start - 8:
        return f"its chunks have {n_bytes} bytes by their table, {at - start - 8} in the file"
    if chunk_size == _VARIABLE and sum(n for n, _ in chunks) != header.point_count:
        return f"its chunks hold {sum(n for n, _ in chunks)} points, its header announces {header.point_count}"
    return None
