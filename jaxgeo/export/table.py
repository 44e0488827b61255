"""A table of results as data, and as CSV, Markdown, LaTeX and HTML: one source for papers, notes and the report."""

import dataclasses
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jaxgeo.export import report_page
from jaxgeo.export.csv_text import csv_text as comma_separated
from jaxgeo.export.number_words import MISSING, THIN, decimal, number_text
from jaxgeo.io.atomic import output_folder

ALL_TABLES = "tables.md"
# A CSV is for computing: digits beyond any measurement, yet without float64's noise (100 * 1.1 = 110.00000000000001).
CSV_DIGITS = 12


@dataclasses.dataclass(frozen=True)
class Column:
    """One column: its head, and how its values are printed.

    Attributes:
        head: without the unit.
        unit: printed in brackets; "" for none.
        group: neighbouring columns of one group share a heading above theirs.
        digits: decimals of floats; None: six significant digits. Whole numbers are never given decimals.
        align: right for numbers, left for words.
        factor: units in one SI unit: 100 for a length printed in cm, 100 for a share printed in %.
        csv_only: too much for a page, such as what a row was computed with.
    """

    head: str
    unit: str = ""
    group: str = ""
    digits: int | None = None
    align: Literal["right", "left"] = "right"
    factor: float = 1.0
    csv_only: bool = False

    @property
    def title(self) -> str:
        """Head and unit."""
        return f"{self.head} [{self.unit}]" if self.unit else self.head

    @property
    def full_title(self) -> str:
        """Group, head and unit, for formats with one header line."""
        return f"{self.group}: {self.title}" if self.group else self.title


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows of values in SI units (metres, shares of one), and how to print them.

    A value is a number, printed as its column says; None or NaN, printed as a dash; or a text, printed as it is.

    Attributes:
        name: of its files, and its label in LaTeX: letters, digits, `-` and `_`.
        title: one line above it; says `simulated` where the numbers are.
        footer: rows below a rule, such as means.
        notes: sentences below it.

    Raises:
        ValueError: a name that cannot name files, or a row that is not as long as `columns`.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    notes: tuple[str, ...] = ()
    footer: tuple[tuple[Any, ...], ...] = ()

    def __post_init__(self):
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", self.name):
            raise ValueError(f"table name {self.name!r}; expected letters, digits, '-' and '_'")
        for row in (*self.rows, *self.footer):
            if len(row) != len(self.columns):
                raise ValueError(
                    f"table {self.name}: row {row!r} has {len(row)} values for {len(self.columns)} columns"
                )

    @property
    def groups(self) -> list[tuple[str, int]]:
        """(group, columns spanned) from left to right; empty where no column has a group."""
        spans: list[tuple[str, int]] = []
        for column in self.columns:
            if spans and spans[-1][0] == column.group:
                spans[-1] = (column.group, spans[-1][1] + 1)
            else:
                spans.append((column.group, 1))
        return spans if any(group for group, _ in spans) else []


def cell_text(value: Any, column: Column) -> str:
    """One value as it is read: in its column's unit and digits, with a true minus sign, a dash where there is none."""
    if isinstance(value, (bool, np.bool_)) or value is None or not isinstance(value, (int, float, np.number)):
        return number_text(bool(value) if isinstance(value, np.bool_) else value)
    if isinstance(value, (int, np.integer)) and column.factor == 1.0:
        return f"{int(value)}".replace("-", "−")
    scaled = column.factor * float(value)
    return number_text(scaled) if column.digits is None else decimal(scaled, column.digits)


def csv_text(table: Table) -> str:
    """The title as a comment line, one header line, and the values in the printed unit with all their digits.

    What is missing is left empty. Notes and footer are not written: the footer can be computed from the rows.
    """
    rows = [[_csv_value(v, c) for v, c in zip(row, table.columns, strict=True)] for row in table.rows]
    return comma_separated([table.title], [c.full_title for c in table.columns], rows)


def markdown_text(table: Table) -> str:
    """A heading, a pipe table and the notes as a list (GitHub Flavored Markdown); footer rows are bold."""
    table = printed(table)
    rule = ["---:" if c.align == "right" else ":---" for c in table.columns]
    body = [[_markdown(text) for text in row] for row in _texts(table.rows, table.columns)]
    foot = [[f"**{_markdown(text)}**" if text else "" for text in row] for row in _texts(table.footer, table.columns)]
    lines = [[_markdown(c.full_title) for c in table.columns], rule, *body, *foot]
    pipes = [f"| {' | '.join(cells)} |" for cells in lines]
    notes = ["", *(f"- {_markdown(note)}" for note in table.notes)] if table.notes else []
    return "\n".join([f"## {_markdown(table.title)}", "", *pipes, *notes, ""])


def latex_text(table: Table) -> str:
    r"""A `tabular` to `\input`; it needs the package booktabs and nothing else.

    Inside a float the title becomes the caption, with the label `tab:NAME`; elsewhere it stands above. Notes follow.
    """
    table = printed(table)
    n = len(table.columns)
    title = _latex(table.title)
    upper = []
    if table.groups:
        heads = [rf"\multicolumn{{{span}}}{{c}}{{{_latex(group)}}}" for group, span in table.groups]
        rules, at = [], 1
        for group, span in table.groups:
            rules += [rf"\cmidrule(lr){{{at}-{at + span - 1}}}"] if group else []
            at += span
        upper = [_latex_row(heads), " ".join(rules)]
    heads = [rf"\multicolumn{{1}}{{{c.align[0]}}}{{{_latex(c.title)}}}" for c in table.columns]
    foot = [_latex_row(map(_latex, row)) for row in _texts(table.footer, table.columns)]
    lines = [
        rf"% Needs \usepackage{{booktabs}}. {n} columns.",
        rf"\ifcsname @captype\endcsname\caption{{{title}}}\label{{tab:{table.name}}}\else\par\noindent {title}\par\fi",
        r"\smallskip",
        rf"\begin{{tabular}}{{@{{}}{''.join(c.align[0] for c in table.columns)}@{{}}}}",
        r"\toprule",
        *upper,
        _latex_row(heads),
        r"\midrule",
        *(_latex_row(map(_latex, row)) for row in _texts(table.rows, table.columns)),
        *([r"\midrule", *foot] if foot else []),
        r"\bottomrule",
        r"\end{tabular}",
        *(rf"\par\smallskip{{\footnotesize {_latex(note)}\par}}" for note in table.notes),
    ]
    return "\n".join([*lines, ""])


def html_text(table: Table, titled: bool = True) -> str:
    """The table for the report's page, notes below it; not `titled` where a heading says what it is."""
    table = printed(table)
    grid = report_page.table(
        table.title if titled else "",
        [c.title for c in table.columns],
        _texts(table.rows, table.columns),
        groups=table.groups,
        footer=_texts(table.footer, table.columns),
        text_columns=[i for i, c in enumerate(table.columns) if c.align == "left"],
    )
    return grid + "".join(report_page.paragraph(note, "note") for note in table.notes)


def printed(table: Table) -> Table:
    """The table without the columns that only the CSV has."""
    kept = [i for i, column in enumerate(table.columns) if not column.csv_only]
    if len(kept) == len(table.columns):
        return table

    def cut(rows: Sequence[Sequence[Any]]) -> tuple[tuple[Any, ...], ...]:
        return tuple(tuple(row[i] for i in kept) for row in rows)

    columns = tuple(table.columns[i] for i in kept)
    return dataclasses.replace(table, columns=columns, rows=cut(table.rows), footer=cut(table.footer))


def table_files(tables: Sequence[Table]) -> dict[str, str]:
    """The text of every file by its name: NAME.csv, NAME.md and NAME.tex of each table, and tables.md with all.

    Raises:
        ValueError: two tables have one name, or one is called `tables`.
    """
    names = [table.name for table in tables]
    for name in names:
        if names.count(name) > 1 or f"{name}.md" == ALL_TABLES:
            raise ValueError(f"table name {name!r} is taken")
    texts = {}
    for table in tables:
        texts[f"{table.name}.csv"] = csv_text(table)
        texts[f"{table.name}.md"] = markdown_text(table)
        texts[f"{table.name}.tex"] = latex_text(table)
    texts[ALL_TABLES] = "\n".join(markdown_text(table) for table in tables)
    return texts


def write_tables(folder: str | Path, tables: Sequence[Table]) -> list[Path]:
    """Write `table_files` into a folder, all or nothing; returns their paths.

    Raises:
        ValueError: as `table_files`.
        InputError: the folder cannot be written to.
    """
    texts = table_files(tables)
    with output_folder(folder) as temporary:
        for name, text in texts.items():
            (temporary / name).write_text(text, encoding="utf-8", newline="\n")
    return [Path(folder) / name for name in texts]


def _texts(rows: Sequence[Sequence[Any]], columns: Sequence[Column]) -> Iterator[list[str]]:
    for row in rows:
        yield [cell_text(value, column) for value, column in zip(row, columns, strict=True)]


def _csv_value(value: Any, column: Column) -> Any:
    if isinstance(value, (bool, np.bool_)) or value is None or not isinstance(value, (int, float, np.number)):
        return value
    if isinstance(value, (int, np.integer)) and column.factor == 1.0:
        return int(value)
    scaled = column.factor * float(value)
    return float(f"{scaled:.{CSV_DIGITS}g}") if math.isfinite(scaled) else None


def _markdown(text: str) -> str:
    """Text whose marks are marks to the eye only; an underscore inside a word is harmless."""
    escaped = re.sub(r"([\\`*|<>$])", r"\\\1", text.replace("\n", " "))
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", escaped)


# What LaTeX reads as a command, and signs that its default fonts do not know by their code point.
_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"$<$",
    ">": r"$>$",
    "|": r"$|$",
    "\n": " ",
    "−": r"$-$",
    "×": r"$\times$",
    "±": r"$\pm$",
    "·": r"$\cdot$",
    "√": r"$\surd$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "≈": r"$\approx$",
    "→": r"$\rightarrow$",
    "∞": r"$\infty$",
    "°": r"$^{\circ}$",
    "²": r"$^{2}$",
    "³": r"$^{3}$",
    "σ": r"$\sigma$",
    "χ": r"$\chi$",
    "μ": r"$\mu$",
    MISSING: "--",
    THIN: r"\,",
    "\u00a0": "~",
}


def _latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)


def _latex_row(cells: Sequence[str] | Iterator[str]) -> str:
    # An empty group first: a row that starts with "[" would be read as the option of the \\ before it
    row = " & ".join(cells)
    return (f"{{}}{row}" if row.startswith(("[", "*")) else row) + r" \\"
