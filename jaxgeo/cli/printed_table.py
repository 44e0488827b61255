"""A table of results on the terminal."""

import sys

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from jaxgeo.export.table import Table, cell_text

PIPED_WIDTH = 160


def print_table(table: Table, console: Console | None = None) -> None:
    """Title, heads and rows as the report has them; without columns that are for computing only, and without notes."""
    # In a file or a pipe nothing says how wide a line may be: wide enough for every table.
    console = console or Console(highlight=False, width=None if sys.stdout.isatty() else PIPED_WIDTH)
    rich = RichTable(title=escape(table.title), title_justify="left", box=SIMPLE)
    shown = [i for i, column in enumerate(table.columns) if not column.csv_only]
    for i in shown:
        column = table.columns[i]
        rich.add_column(escape(column.title), justify=column.align, no_wrap=i == 0)
    for row in (*table.rows, *table.footer):
        rich.add_row(*(escape(cell_text(row[i], table.columns[i])) for i in shown))
    console.print(rich)
