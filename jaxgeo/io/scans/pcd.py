"""PCD files (ascii, binary, binary_compressed): the columns of their points, by the names of the fields.

The header is text, a keyword and its values a line, ending with `DATA`; the points follow in rows, or, compressed,
column by column as one LZF block behind its two sizes (the Point Cloud Library's file format 0.7).
"""

import dataclasses
from pathlib import Path
from typing import NoReturn

import numpy as np

from jaxgeo.io.scans.lzf import unpacked
from jaxgeo.io.scans.scan_source import UnreadableScanError

_TYPES = {"F": ("f4", "f8"), "I": ("i1", "i2", "i4", "i8"), "U": ("u1", "u2", "u4", "u8")}
_LONGEST_HEADER = 100_000
_LARGEST_COUNT = 10_000
_MOST_DIGITS = 18


@dataclasses.dataclass(frozen=True)
class _Header:
    fields: list[str]
    sizes: list[int]
    types: list[str]
    counts: list[int]
    n_points: int
    data: str
    offset: int
    line: int

    @property
    def dtype(self) -> np.dtype:
        """A packed row. Columns of several numbers and padding (`_`) get names that no reader asks for."""
        formats = [f"<{kind.lower()}{size}" for kind, size in zip(self.types, self.sizes, strict=True)]
        names = [
            name if name != "_" and count == 1 and self.fields.index(name) == i else f"{i}:{name}"
            for i, (name, count) in enumerate(zip(self.fields, self.counts, strict=True))
        ]
        return np.dtype(
            [
                (name, form, (count,)) if count != 1 else (name, form)
                for name, form, count in zip(names, formats, self.counts, strict=True)
            ]
        )


def read_pcd(path: str | Path, data: bytes) -> dict[str, np.ndarray]:
    """The fields with one number a point, by name.

    Raises:
        UnreadableScanError: with line: a malformed header, or fewer points than it announces.
    """
    header = _read_header(path, data)
    body = data[header.offset :]
    if header.data == "ascii":
        return _of_text(path, header, body)
    dtype = header.dtype
    if header.data == "binary_compressed":
        return _of_compressed(path, header, body)
    if len(body) < header.n_points * dtype.itemsize:
        raise UnreadableScanError(
            f"{path}: the header announces {header.n_points} points of {dtype.itemsize} bytes, but the file ends after "
            f"{len(body) // dtype.itemsize} of them. Was copying or writing it cut off?"
        )
    rows = np.frombuffer(body, dtype, header.n_points)
    return {name: rows[name] for name in _single(header)}


def _single(header: _Header) -> list[str]:
    dtype = header.dtype
    return [name for name in dtype.names or () if ":" not in name]


def _of_text(path: str | Path, header: _Header, body: bytes) -> dict[str, np.ndarray]:
    rows = body.decode("ascii", "replace").splitlines()[: header.n_points]
    n_columns = sum(header.counts)
    if len(rows) < header.n_points:
        raise UnreadableScanError(
            f"{path}:{header.line + len(rows)}: the header announces {header.n_points} points, but the file ends after "
            f"{len(rows)} of them. Was copying or writing it cut off?"
        )
    if not rows:
        return {name: np.empty(0) for name in _single(header)}
    if not rows[0].strip():
        _refuse_row(path, header, rows, n_columns)
    try:
        values = np.loadtxt(rows, comments=None, ndmin=2)
    except ValueError:
        _refuse_row(path, header, rows, n_columns)
    if values.shape != (len(rows), n_columns):  # loadtxt leaves blank lines out
        _refuse_row(path, header, rows, n_columns)
    first = np.cumsum([0, *header.counts])
    names = header.dtype.names or ()
    # Text keeps no type, but the type says the unit of times
    with np.errstate(invalid="ignore", over="ignore"):
        return {name: values[:, first[names.index(name)]].astype(header.dtype[name]) for name in _single(header)}


def _refuse_row(path: str | Path, header: _Header, rows: list[str], n_columns: int) -> NoReturn:
    for line, row in enumerate(rows, start=header.line + 1):
        words = row.split()
        if len(words) == n_columns and all(map(_is_number, words)):
            continue
        raise UnreadableScanError(
            f"{path}:{line}: {row[:60]!r}; expected {n_columns} numbers ({', '.join(header.fields)}). Mend the row, or "
            "the count of points in the header."
        )
    raise UnreadableScanError(f"{path}:{header.line + 1}: the rows from here are not {n_columns} numbers each.")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return word.isascii() and "_" not in word


def _of_compressed(path: str | Path, header: _Header, body: bytes) -> dict[str, np.ndarray]:
    dtype = header.dtype
    size = header.n_points * dtype.itemsize
    packed, full = (int(x) for x in np.frombuffer(body[:8], "<u4")) if len(body) >= 8 else (0, 0)
    if len(body) < 8 + packed or full != size:
        raise UnreadableScanError(
            f"{path}: {len(body)} bytes of data announce {packed} packed bytes for {full}; the header's "
            f"{header.n_points} points of {dtype.itemsize} bytes need {size}. Was copying or writing it cut off?"
        )
    try:
        columns = unpacked(body[8 : 8 + packed], full)
    except ValueError as failure:
        raise UnreadableScanError(f"{path}: the compressed points are damaged: {failure}. Copy it again.") from None
    out = {}
    at = 0
    for name in dtype.names or ():
        if ":" not in name:
            out[name] = np.frombuffer(columns, dtype[name], header.n_points, at)
        at += header.n_points * dtype[name].itemsize
    return out


def _read_header(path: str | Path, data: bytes) -> _Header:
    offset, line = 0, 0
    found: dict[str, list[str]] = {}
    while "DATA" not in found:
        end = data.find(b"\n", offset, _LONGEST_HEADER)
        if end < 0:
            what = f"begins with {data[:16]!r}" if data else "is empty"
            raise UnreadableScanError(
                f"{path}: {what} and has no line `DATA`, with which the header of a PCD file ends. Is it of another "
                "format, or cut off?"
            )
        words = data[offset:end].decode("utf-8", "replace").split()
        offset, line = end + 1, line + 1
        if words and not words[0].startswith("#"):
            found[words[0].upper()] = words[1:]
    fields = found.get("FIELDS") or found.get("COLUMNS") or []
    counts = found.get("COUNT") or ["1"] * len(fields)
    points = found.get("POINTS") or _product(found)
    layout = _layout(path, fields, found.get("SIZE", []), found.get("TYPE", []), counts, points)
    kind = " ".join(found["DATA"])
    if kind not in ("ascii", "binary", "binary_compressed"):
        raise UnreadableScanError(f"{path}:{line}: DATA {kind!r:.40}, expected ascii, binary or binary_compressed.")
    return _Header(fields, *layout, kind, offset, line)


def _product(found: dict[str, list[str]]) -> list[str]:
    """POINTS by WIDTH and HEIGHT, where the line is missing."""
    sides = found.get("WIDTH", []) + found.get("HEIGHT", [])
    return [str(int(sides[0]) * int(sides[1]))] if len(sides) == 2 and all(map(_is_count, sides)) else []


def _is_count(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS


def _layout(
    path: str | Path, fields: list[str], sizes: list[str], types: list[str], counts: list[str], points: list[str]
) -> tuple[list[int], list[str], list[int], int]:
    """Sizes, types, counts and the number of points, checked."""
    for keyword, values in (("SIZE", sizes), ("TYPE", types), ("COUNT", counts)):
        if not fields or len(values) != len(fields):
            raise UnreadableScanError(
                f"{path}: the header has {len(fields)} FIELDS and {len(values)} of {keyword}, expected as many. Mend "
                "the header, or write the file again."
            )
    known = {kind + form[1]: form for kind, forms in _TYPES.items() for form in forms}
    for name, kind, size, count in zip(fields, types, sizes, counts, strict=True):
        if kind + size not in known or not _is_count(count) or not 0 < int(count) <= _LARGEST_COUNT:
            raise UnreadableScanError(
                f"{path}: field {name!r:.40} is of TYPE {kind:.9} SIZE {size:.9} COUNT {count:.20}; expected F (4, 8), "
                f"I or U (1, 2, 4, 8) and a count of 1 to {_LARGEST_COUNT}."
            )
    if len(points) != 1 or not _is_count(points[0]):
        raise UnreadableScanError(f"{path}: POINTS {' '.join(points)[:40] or 'missing'}, expected a number of points.")
    return [int(size) for size in sizes], types, [int(count) for count in counts], int(points[0])
