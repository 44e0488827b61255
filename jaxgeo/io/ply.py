"""PLY files: the vertices, read and written piece by piece, so that a cloud larger than memory passes through.

The header is text, `element vertex <count>` and one `property <type> <name>` a column; the rows follow as text or as
packed binary of either byte order (Turk, "The PLY polygon file format", 1994). Faces and what else follows the vertices
are left alone.
"""

import contextlib
import dataclasses
import itertools
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, NoReturn, Self

import numpy as np

from jaxgeo.errors import CloudError, InputError
from jaxgeo.io.atomic import atomic_path
from jaxgeo.io.regular_file import check_regular

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_NAMES = {code: name for name, code in reversed(_TYPES.items())}  # the older names, which every reader knows
_BYTE_ORDER = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_LINE = 4096
_MOST_LINES = 10_000
_TEXT_ROWS = 100_000  # text rows parsed at once: their strings take several times the memory of their numbers
_COUNT_WIDTH = 12


@dataclasses.dataclass(frozen=True)
class PlyHeader:
    """What the head of a PLY file says about its vertices.

    Attributes:
        format: `ascii`, `binary_little_endian` or `binary_big_endian`.
        n_vertices: as announced; `ply_vertices` finds out whether they are there.
        dtype: structured, one field a property, in the byte order of the file.
        comments: of `comment` and `obj_info` lines, without these words.
        offset: bytes before the first vertex.
        line: lines before the first vertex; of an `ascii` file, its rows are counted on from here.
        error: what its readers raise.
    """

    format: str
    n_vertices: int
    dtype: np.dtype
    comments: tuple[str, ...]
    offset: int
    line: int
    error: type[InputError]


@dataclasses.dataclass
class _Element:
    name: str
    count: int
    line: int
    fields: list[tuple[str, str]] = dataclasses.field(default_factory=list)
    lists: list[str] = dataclasses.field(default_factory=list)


def read_ply_header(path: str | Path, error: type[InputError] = CloudError) -> PlyHeader:
    """Read the head of a PLY file.

    Raises:
        error: no such file, not a PLY file, a malformed header, no vertices, or vertices with list properties.
    """
    with _opened(path, error) as file:
        lines = _header_lines(path, file, error)
        offset = file.tell()
        order = _format(path, lines, error)
        elements, comments = _elements(path, lines, error)
        before = list(itertools.takewhile(lambda element: element.name != "vertex", elements))
        if len(before) == len(elements):
            named = ", ".join(element.name for element in elements) or "none"
            raise error(f"{path}: no `element vertex` in the header (elements: {named}). Is it a point cloud at all?")
        vertex = elements[len(before)]
        for element in (*before, vertex):
            if element.lists:
                raise error(
                    f"{path}:{element.line}: element {element.name!r} has the list property {element.lists[0]!r}; "
                    "expected plain numbers up to the vertices. Export the points alone."
                )
        if not vertex.fields:
            raise error(f"{path}:{vertex.line}: the vertices have no properties; expected at least x, y, z.")
        line = len(lines)
        for element in before:
            if order == "ascii":
                for row in itertools.islice(file, min(element.count, sys.maxsize)):
                    offset += len(row)
                    line += 1
            else:
                offset += element.count * np.dtype(element.fields).itemsize
    dtype = np.dtype([(name, _BYTE_ORDER[order] + code) for name, code in vertex.fields])
    return PlyHeader(order, vertex.count, dtype, comments, offset, line, error)


def ply_vertices(path: str | Path, header: PlyHeader, chunk: int = 1_000_000) -> Iterator[np.ndarray]:
    """The vertices, in order, as structured arrays of at most `chunk` rows.

    Raises:
        header.error: the file ends before the announced vertices do (before the first row is given, where the file is
            binary), or a row of text is not what the header says.
    """
    if header.format == "ascii":
        yield from _text_vertices(path, header, min(chunk, _TEXT_ROWS))
        return
    there = (Path(path).stat().st_size - header.offset) // header.dtype.itemsize
    if there < header.n_vertices:
        raise header.error(
            f"{path}: the header announces {header.n_vertices} vertices of {header.dtype.itemsize} bytes, but the file "
            f"ends after {max(there, 0)} of them, at byte {Path(path).stat().st_size}. Was copying or writing it cut "
            "off?"
        )
    with _opened(path, header.error) as file:
        file.seek(header.offset)
        for start in range(0, header.n_vertices, chunk):
            yield np.fromfile(file, header.dtype, min(chunk, header.n_vertices - start))


class PlyWriter:
    """Writes vertices as binary PLY, block by block; the file appears, with its count, when the block ends well.

    Fields must be integers of up to 32 bits or floats of 32 or 64 bits. Use as a context manager.
    """

    def __init__(self, path: str | Path, dtype: np.dtype, comments: Sequence[str] = ()) -> None:
        """Raises CloudError for a field that PLY has no type for, or a name or comment that would break the header."""
        self._path = path
        self._dtype = dtype.newbyteorder("<")
        self._comments = [_checked_comment(path, comment) for comment in comments]
        self._properties = [_property_line(path, name, dtype) for name in dtype.names or ()]
        self.count = 0

    def __enter__(self) -> Self:
        self._stack = contextlib.ExitStack()
        with contextlib.ExitStack() as stack:
            temporary = stack.enter_context(atomic_path(self._path))
            self._file = stack.enter_context(temporary.open("wb"))
            head = ["ply", "format binary_little_endian 1.0", *(f"comment {c}" for c in self._comments)]
            self._file.write(("\n".join(head) + "\nelement vertex ").encode("ascii", "replace"))
            self._count_at = self._file.tell()
            rest = [" " * _COUNT_WIDTH, *self._properties, "end_header"]
            self._file.write(("\n".join(rest) + "\n").encode("ascii"))
            self._stack = stack.pop_all()
        return self

    def append(self, vertices: np.ndarray) -> None:
        """Write rows of a structured array with the fields of the file."""
        rows = np.ascontiguousarray(vertices.astype(self._dtype, copy=False))
        rows.tofile(self._file)
        self.count += len(rows)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._file.seek(self._count_at)
            # Blanks behind the number, not zeros before it: some readers take those for octal.
            self._file.write(f"{self.count:<{_COUNT_WIDTH}d}".encode())
        self._stack.__exit__(kind, error, trace)


@contextlib.contextmanager
def _opened(path: str | Path, error: type[InputError]) -> Iterator[IO[bytes]]:
    check_regular(path, error)
    try:
        file = Path(path).open("rb")  # noqa: SIM115 (closed below; only a failure to open is to be caught)
    except FileNotFoundError:
        raise error(f"{path}: no such file. Check the path.") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder, expected a PLY file. Name the file in it.") from None
    except OSError as failure:
        raise error(f"{path}: cannot be read: {failure.strerror}.") from None
    with file:
        yield file


def _header_lines(path: str | Path, file: IO[bytes], error: type[InputError]) -> list[str]:
    lines: list[str] = []
    for number in range(1, _MOST_LINES + 1):
        data = file.readline(_LONGEST_LINE)
        text = data.decode("utf-8", "replace").rstrip()
        if number == 1 and text != "ply":
            what = f"starts with {data[:16]!r}" if data else "is empty"
            raise error(f"{path}: {what}; a PLY file starts with a line `ply`. Is it of another format, or cut off?")
        if not data.endswith(b"\n"):
            break
        lines.append(text)
        if text == "end_header":
            return lines
    raise error(
        f"{path}:{max(len(lines), 1)}: the header does not come to its `end_header`. Is the file cut off or no PLY?"
    )


def _format(path: str | Path, lines: list[str], error: type[InputError]) -> str:
    at = next((i for i, line in enumerate(lines) if line.split()[:1] == ["format"]), None)
    words = [] if at is None else lines[at].split()
    if len(words) != 3 or words[1] not in _BYTE_ORDER:
        found = "no `format` line" if at is None else repr(lines[at][:80])
        raise error(f"{path}:{(at or 0) + 1}: {found}; expected `format {'|'.join(_BYTE_ORDER)} 1.0`.")
    return words[1]


def _elements(path: str | Path, lines: list[str], error: type[InputError]) -> tuple[list[_Element], tuple[str, ...]]:
    elements: list[_Element] = []
    comments: list[str] = []
    for number, line in enumerate(lines[1:-1], start=2):
        match line.split():
            case ["comment" | "obj_info", *_]:
                comments.append(line.split(maxsplit=1)[1] if len(line.split(maxsplit=1)) > 1 else "")
            case [] | ["format", *_]:
                pass
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append(_Element(name, int(count), number))
            case ["property", "list", _, _, name] if elements:
                elements[-1].lists.append(name)
            case ["property", kind, name] if elements and kind in _TYPES:
                if any(name == other for other, _ in elements[-1].fields):
                    raise error(f"{path}:{number}: property {name[:80]!r} a second time; expected each name once.")
                elements[-1].fields.append((name, _TYPES[kind]))
            case _:
                raise error(
                    f"{path}:{number}: {line[:80]!r} in the header; expected `element NAME COUNT`, `comment`, or "
                    f"`property TYPE NAME` with one of the types {', '.join(_TYPES)}."
                )
    return elements, tuple(comments)


def _text_vertices(path: str | Path, header: PlyHeader, chunk: int) -> Iterator[np.ndarray]:
    with _opened(path, header.error) as file:
        file.seek(header.offset)
        for start in range(0, header.n_vertices, chunk):
            size = min(chunk, header.n_vertices - start)
            rows = list(itertools.islice(file, size))
            first_line = header.line + start + 1
            if len(rows) < size:
                raise header.error(
                    f"{path}:{first_line + len(rows)}: the header announces {header.n_vertices} vertices, but the file "
                    f"ends after {start + len(rows)} of them. Was copying or writing it cut off?"
                )
            yield _numbers_of(path, header, rows, first_line)


def _numbers_of(path: str | Path, header: PlyHeader, rows: list[bytes], first_line: int) -> np.ndarray:
    names = header.dtype.names or ()
    if rows and not rows[0].strip():
        _refuse_row(path, header, rows, first_line)
    try:
        values = np.loadtxt(rows, comments=None, ndmin=2)
    except ValueError:
        _refuse_row(path, header, rows, first_line)
    if values.shape != (len(rows), len(names)):  # loadtxt leaves blank lines out
        _refuse_row(path, header, rows, first_line)
    out = np.empty(len(rows), header.dtype)
    for i, name in enumerate(names):
        kind = header.dtype[name]
        if kind.kind in "iu":
            limits = np.iinfo(kind)
            inside = (values[:, i] >= limits.min) & (values[:, i] <= limits.max)
            wrong = ~inside | (values[:, i] != np.floor(values[:, i]))
            if wrong.any():
                row = int(np.argmax(wrong))
                raise header.error(
                    f"{path}:{first_line + row}: property {name!r} holds {values[row, i]:g}; expected a whole number "
                    f"from {limits.min} to {limits.max}."
                )
        with np.errstate(over="ignore"):  # beyond float32: infinite, as it would be in a binary file
            out[name] = values[:, i]
    return out


def _refuse_row(path: str | Path, header: PlyHeader, rows: list[bytes], first_line: int) -> NoReturn:
    names = header.dtype.names or ()
    for line, row in enumerate(rows, start=first_line):
        words = row.split()
        if len(words) == len(names) and all(map(_is_number, words)):
            continue
        shown = row[:60].decode("utf-8", "replace").strip()
        raise header.error(
            f"{path}:{line}: {shown!r}; expected {len(names)} numbers: {', '.join(names)[:400]}. Mend the row, or "
            "the count of the vertices in the header."
        )
    raise header.error(f"{path}:{first_line}: {len(rows)} rows from here are not {len(names)} numbers each.")


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return b"_" not in word


def _checked_comment(path: str | Path, comment: str) -> str:
    if "\n" in comment or "\r" in comment or not comment.isascii() or len(comment) > _LONGEST_LINE - 16:
        raise CloudError(f"{path}: comment {comment[:60]!r}; expected one line of plain ASCII.")
    return comment


def _property_line(path: str | Path, name: str, dtype: np.dtype) -> str:
    kind = _NAMES.get(dtype[name].str[1:])
    if kind is None or not name.isascii() or len(name.split()) != 1 or name.split()[0] != name:
        raise CloudError(
            f"{path}: field {name!r} of type {dtype[name]} cannot be a PLY property; expected a name without blanks "
            f"and one of {', '.join(sorted(set(_TYPES.values())))}."
        )
    return f"property {kind} {name}"
