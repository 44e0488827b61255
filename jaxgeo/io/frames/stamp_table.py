"""Tables that say when each image of a folder was taken: our CSV, TUM's `rgb.txt`, EuRoC's `data.csv`."""

import dataclasses
import re
from pathlib import Path

from jaxgeo.errors import DetectError
from jaxgeo.io.frames.stamps import POWERS, number_of, seconds, unit_of
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.text_table import TextTable, read_table, text_column

STAMP_NAMES = ("stamp", "timestamp", "time", "t")
FILE_NAMES = ("file", "filename", "file_name", "image", "name", "path")
CAMERA_NAMES = ("camera", "cam")
_UNIT = re.compile(r"[\[(]\s*(s|ms|us|ns)\s*[\])]")


@dataclasses.dataclass(frozen=True)
class StampRow:
    """One row: image `file` of `camera` (None: the table names none) was taken at `stamp_s`; `place` is file:line."""

    stamp_s: float
    file: str
    camera: str | None
    place: str


def read_stamp_table(path: str | Path) -> list[StampRow]:
    """Read stamps and file names, in the order of the table.

    With a header: columns `stamp` (or timestamp, time) with its unit (`stamp_s`, `timestamp [ns]`), `file` (or
    filename, image) and, if there, `camera`; other columns are not read. Without one: stamp, file and, if there,
    camera. The unit of stamps that do not say it is seen from their size: seconds, or nanoseconds since 1970. Stamps
    become the float64 seconds nearest to their decimal digits.

    Raises:
        DetectError: with file and line.
    """
    table = read_table(path, error=DetectError)
    stamp, file, camera, unit = _columns(table)
    texts = text_column(table, stamp)
    numbers = [number_of(text) for text in texts]
    if None in numbers:
        row = numbers.index(None)
        raise DetectError(f"{table.place(row)}: stamp {texts[row][:40]!r}, expected a number: mend or remove the row.")
    known = [number for number in numbers if number is not None]
    unit = unit or unit_of(known, str(path))
    names = text_column(table, file)
    cameras = text_column(table, camera) if camera is not None else [None] * len(table)
    for row, name in enumerate(names):
        if not name or number_of(name) is not None:
            raise DetectError(
                f"{table.place(row)}: column {file} (counted from 0) holds {name!r}, expected the name of an image. "
                "Name the columns in a header: stamp_s, file."
            )
        if cameras[row] == "":
            raise DetectError(f"{table.place(row)}: no camera, expected a name in every row or no such column.")
    return [
        StampRow(seconds(number, unit), name, of, table.place(row))
        for row, (number, name, of) in enumerate(zip(known, names, cameras, strict=True))
    ]


def _columns(table: TextTable) -> tuple[int, int, int | None, str | None]:
    """Indices of the columns of stamps, files and cameras (None: no such column), and the stamps' unit if said."""
    titled = {f"{name}_{unit}": unit for name in STAMP_NAMES for unit in POWERS} | dict.fromkeys(STAMP_NAMES)
    names = [title.casefold() for title in table.header]
    found = [[i for i, name in enumerate(names) if name in known] for known in (titled, FILE_NAMES, CAMERA_NAMES)]
    for role, index in zip(("stamps", "files", "cameras"), found, strict=True):
        if len(index) > 1:
            columns = ", ".join(table.header[i] for i in index)
            raise DetectError(f"{table.path}: {len(index)} columns of {role}: {columns}. Keep one of them.")
    stamp, file, camera = (index[0] if index else None for index in found)
    if stamp is not None and file is not None:
        return stamp, file, camera, titled[names[stamp]] or _unit_in_brackets(table)
    if table.header or table.n_columns not in (2, 3):
        has = ", ".join(table.header) if table.header else f"{table.n_columns} columns without names"
        raise DetectError(
            f"{table.path}: the table has {has}; expected columns stamp_s and file and, if there are several cameras, "
            "camera. Add or rename the header."
        )
    return 0, 1, 2 if table.n_columns == 3 else None, None


def _unit_in_brackets(table: TextTable) -> str | None:
    """The unit of a header such as `#timestamp [ns],filename`."""
    above = read_lines(table.path, DetectError)[: int(table.line[0]) - 1]
    found = [unit for line in above for unit in _UNIT.findall(line)]
    return found[-1] if found else None
