"""Delimited text tables: the one place that reads them.

A table's delimiter is guessed, its header is optional (with or without a leading `#`), lines starting with `#` and
blank lines are skipped, and every row keeps the number of its line for messages. Numbers are parsed in bulk by NumPy,
block by block; only where that fails are the rows read one by one, to name the guilty line.
"""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.errors import InputError
from jaxgeo.io.text_file import read_lines

_UNIT = re.compile(r"\s*(\([^()]*\)|\[[^\[\]]*\])")
_BLOCK_ROWS = 10_000
_LONGEST_NAME = 200  # of a column: what is longer is no header, and would fill the screen
_DELIMITER_NAMES = {None: "blanks", ",": "comma", ";": "semicolon", "\t": "tab"}


@dataclasses.dataclass(frozen=True)
class TextTable:
    """The data rows of a delimited text file, not yet split.

    Attributes:
        path: the file.
        rows: one text per data row.
        line: (n,) its line in the file, counted from 1.
        delimiter: None stands for any run of blanks.
        n_columns: the same in all rows.
        header: column names without their units in brackets; empty where the file names none.
        error: what its readers raise.
    """

    path: str | Path
    rows: list[str]
    line: Int[np.ndarray, "n"]
    delimiter: str | None
    n_columns: int
    header: tuple[str, ...]
    error: type[InputError]

    def __len__(self) -> int:
        return len(self.rows)

    def place(self, row: int) -> str:
        return f"{self.path}:{self.line[row]}"


def read_table(path: str | Path, *, delimiter: str | None = None, error: type[InputError] = InputError) -> TextTable:
    """Open a delimited text table.

    Args:
        path: the file.
        delimiter: one character (a blank: any run of blanks); default: guessed from the first data row, in the order
            semicolon, tab, comma, blanks.
        error: the kind of error to raise.

    Raises:
        error: the file cannot be read, holds no data row, or its rows have different numbers of columns.
    """
    if delimiter is not None and len(delimiter) != 1:
        raise error(f"{path}: delimiter {delimiter!r}: expected one character, such as ',' ';' or a tab.")
    lines = read_lines(path, error)
    stripped = [text.strip() for text in lines]
    number = [i for i, text in enumerate(stripped, start=1) if text and text[0] != "#"]
    if not number:
        raise error(f"{path}: no data rows, only comments. Is this the right file, and complete?")
    first = lines[number[0] - 1]
    titled = not any(_is_number(cell) for cell in _split(first, _chosen(delimiter, first)))
    title = first if titled else ""
    if titled:
        number = number[1:]
        if not number:
            raise error(
                f"{path}:{len(lines)}: a header ({title.strip()[:80]!r}) but no data rows. Is the file complete?"
            )
    rows = [lines[i - 1] for i in number]
    table = table_of_rows(path, rows, np.array(number), delimiter=_chosen(delimiter, rows[0]), error=error)
    titles = [title] if titled else [text.lstrip("# ") for text in stripped[: number[0] - 1] if text]
    return dataclasses.replace(table, header=_header(titles, table))


def table_of_rows(
    path: str | Path,
    rows: list[str],
    line: Int[np.ndarray, "n"],
    *,
    delimiter: str | None,
    error: type[InputError],
) -> TextTable:
    """A table of rows at hand, all with the same number of columns; `delimiter=None`: blanks.

    Raises:
        error: a row has another number of columns than the first.
    """
    counts = [len(row.split()) for row in rows] if delimiter is None else [row.count(delimiter) + 1 for row in rows]
    n_columns = counts[0]
    if counts.count(n_columns) != len(counts):
        bad = next(i for i, count in enumerate(counts) if count != n_columns)
        separator = _DELIMITER_NAMES.get(delimiter, repr(delimiter))
        raise error(
            f"{path}:{line[bad]}: {counts[bad]} columns, expected {n_columns} as in line {line[0]} (separator: "
            f"{separator}). Complete or remove the row."
        )
    return TextTable(path, rows, line, delimiter, n_columns, (), error)


def column_index(table: TextTable, column: str | int) -> int:
    """Index of a column given by header name (exact, else ignoring case) or by 0-based index.

    Raises:
        table.error: there is no such column, or the name occurs twice.
    """
    if isinstance(column, int) and not isinstance(column, bool):
        if 0 <= column < table.n_columns:
            return column
        raise table.error(
            f"{table.path}: column index {column}, but the table has {table.n_columns} columns: expected 0 to "
            f"{table.n_columns - 1}."
        )
    if not table.header:
        raise table.error(
            f"{table.path}: column {column!r} is asked for by name, but the file has no header line with "
            f"{table.n_columns} names. Give 0-based column indices (0 to {table.n_columns - 1}), or add a header."
        )
    name = str(column)
    found = [i for i, title in enumerate(table.header) if title == name]
    found = found or [i for i, title in enumerate(table.header) if title.casefold() == name.casefold()]
    if len(found) == 1:
        return found[0]
    problem = f"no column named {name!r}" if not found else f"{len(found)} columns named {name!r}"
    raise table.error(f"{table.path}: {problem}; the header has {', '.join(table.header)}.")


def float_columns(
    table: TextTable, columns: Sequence[str | int], *, blank_is_nan: bool = False
) -> Float[np.ndarray, "n columns"]:
    """The chosen columns as float64.

    Args:
        table: the table.
        columns: header names or 0-based indices.
        blank_is_nan: an empty cell (or `nan`) is NaN; otherwise it is an error.

    Raises:
        table.error: a cell is not a finite number; names line and column.
    """
    index = [column_index(table, column) for column in columns]
    starts = range(0, len(table), _BLOCK_ROWS)
    values = np.concatenate([_block_numbers(table, start, index, blank_is_nan) for start in starts])
    wrong = np.isinf(values) if blank_is_nan else ~np.isfinite(values)
    if wrong.any():
        row, at = np.argwhere(wrong)[0]
        _refuse_cell(table, int(row), index[at], "expected a finite number: remove or mend the row")
    return values


def text_column(table: TextTable, column: str | int) -> list[str]:
    """One column as text, without surrounding blanks and quotes."""
    index = column_index(table, column)
    return [row.split(table.delimiter, index + 1)[index].strip().strip('"') for row in table.rows]


def _block_numbers(
    table: TextTable, start: int, index: list[int], blank_is_nan: bool
) -> Float[np.ndarray, "m columns"]:
    rows = table.rows[start : start + _BLOCK_ROWS]
    try:
        return np.loadtxt(rows, delimiter=table.delimiter, usecols=index, comments=None, ndmin=2)
    except ValueError:
        return np.array([_row_numbers(table, start + i, index, blank_is_nan) for i in range(len(rows))])


def _row_numbers(table: TextTable, row: int, index: list[int], blank_is_nan: bool) -> list[float]:
    cells = _split(table.rows[row], table.delimiter)
    numbers = []
    for at in index:
        if _is_number(cells[at]):
            numbers.append(float(cells[at]))
        elif blank_is_nan and not cells[at]:
            numbers.append(np.nan)
        else:
            hint = (
                "a decimal comma? write a decimal point"
                if re.search(r"\d,\d", cells[at])
                else "expected a number: mend the row"
            )
            _refuse_cell(table, row, at, hint)
    return numbers


def _refuse_cell(table: TextTable, row: int, at: int, hint: str) -> NoReturn:
    name = repr(table.header[at]) if table.header else f"{at} (counted from 0)"
    cell = _split(table.rows[row], table.delimiter)[at]
    raise table.error(f"{table.place(row)}: column {name} holds {cell[:40]!r}; {hint}.")


def _is_number(cell: str) -> bool:
    """What NumPy's bulk parser takes too: `float` alone would also pass 1_000 and non-Latin digits."""
    if "_" in cell or not cell.isascii():
        return False
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _split(row: str, delimiter: str | None) -> list[str]:
    return [cell.strip() for cell in row.split(delimiter)]


def _chosen(delimiter: str | None, row: str) -> str | None:
    if delimiter is None:
        delimiter = next((mark for mark in ";\t," if mark in row.strip()), " ")
    return None if delimiter == " " else delimiter


def _header(titles: list[str], table: TextTable) -> tuple[str, ...]:
    """Names from the last line above the data that has one name for each column."""
    for title in reversed(titles):
        names = [cell.strip('"') for cell in _split(_UNIT.sub("", title), table.delimiter)]
        sound = all(0 < len(name) <= _LONGEST_NAME and not _is_number(name) for name in names)
        if len(names) == table.n_columns and sound:
            return tuple(names)
    return ()
