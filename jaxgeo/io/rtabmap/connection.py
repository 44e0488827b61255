"""A database of others, opened to be read only: nothing in it runs, and nothing beside it is written."""

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path

from jaxgeo.errors import InputError

LARGEST_VALUE_BYTES = 1 << 28
_MAGIC = b"SQLite format 3\x00"


@contextlib.contextmanager
def open_read_only(path: str | Path, tables: Sequence[str]) -> Iterator[sqlite3.Connection]:
    """A connection that can do nothing but read ordinary tables.

    The file is taken as it is (`immutable`): no lock, no journal, no file beside it. An authoriser lets through SELECT
    on columns only: no functions, no triggers, no views, no other files.

    Args:
        path: the database.
        tables: those that must be there.

    Raises:
        InputError: no such file, not SQLite, a transaction not finished, or one of `tables` is missing or no ordinary
            table.
    """
    _check_file(path)
    try:
        uri = f"{Path(path).resolve().as_uri()}?mode=ro&immutable=1"
        connection = sqlite3.connect(uri, uri=True, isolation_level=None)
    except sqlite3.Error as failure:
        raise InputError(f"{path}: cannot be opened as an SQLite database: {failure}.") from None
    with contextlib.closing(connection):
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_VALUE_BYTES)
        connection.text_factory = lambda data: data.decode("utf-8", "replace")
        with refusals(path):
            for pragma in ("trusted_schema = OFF", "query_only = ON", "cell_size_check = ON"):
                connection.execute(f"PRAGMA {pragma}")
            _check_tables(path, connection, tables)
            connection.set_authorizer(_only_reading)
        yield connection


@contextlib.contextmanager
def refusals(path: str | Path) -> Iterator[None]:
    """What SQLite refuses inside of the block, as an InputError."""
    try:
        yield
    except sqlite3.Error as failure:
        raise InputError(
            f"{path}: SQLite cannot read it: {failure}. Is the file damaged, cut off, or made to be? "
            "`sqlite3 FILE 'PRAGMA integrity_check'` tells more."
        ) from None


def columns_of(connection: sqlite3.Connection, table: str) -> tuple[str, ...]:
    """The names of a table's columns; `table` is a name of this program's, never of a file."""
    return tuple(column[0] for column in connection.execute(f"SELECT * FROM {table} LIMIT 0").description)


def _check_file(path: str | Path) -> None:
    if Path(path).exists() and not (Path(path).is_file() or Path(path).is_dir()):
        raise InputError(f"{path}: is a device or a pipe, expected an RTAB-Map database (.db).")
    try:
        with Path(path).open("rb") as file:
            magic = file.read(len(_MAGIC))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file. Check the path.") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, expected an RTAB-Map database (.db). Name the file in it.") from None
    except OSError as failure:
        raise InputError(f"{path}: cannot be read: {failure.strerror}.") from None
    if magic != _MAGIC:
        what = f"begins with {magic!r}" if magic else "is empty"
        raise InputError(f"{path}: {what}; an RTAB-Map database is an SQLite file. Is it of another kind, or cut off?")
    for end in ("-wal", "-journal"):
        beside = Path(f"{Path(path).resolve()}{end}")
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{path}: {beside.name} lies beside it: something still writes, or was killed while writing. Close "
                "RTAB-Map, or open and close the database once with it, and try again."
            )


def _check_tables(path: str | Path, connection: sqlite3.Connection, tables: Sequence[str]) -> None:
    found = {name: (kind, sql) for name, kind, sql in connection.execute("SELECT name, type, sql FROM sqlite_master")}
    for table in tables:
        if table not in found:
            there = ", ".join(sorted(name for name, (kind, _) in found.items() if kind == "table")[:8]) or "none"
            raise InputError(
                f"{path}: no table {table!r} (tables: {there}); expected an RTAB-Map database of version 0.13 or later."
            )
        kind, sql = found[table]
        if kind != "table" or not str(sql).lstrip().upper().startswith("CREATE TABLE"):
            raise InputError(
                f"{path}: {table!r} is a {'virtual table' if kind == 'table' else kind}, expected an ordinary table. "
                "RTAB-Map does not write such a database: do not trust it."
            )
        # An authoriser is not asked about the expressions of computed columns.
        computed = [row[1] for row in connection.execute(f"PRAGMA table_xinfo({table})") if row[6]]
        if computed:
            raise InputError(
                f"{path}: column {computed[0]!r} of table {table!r} is computed, expected stored values. RTAB-Map does "
                "not write such a database: do not trust it."
            )


def _only_reading(action: int, first: str | None, second: str | None, database: str | None, inside: str | None) -> int:
    allowed = action in (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ) and inside is None
    return sqlite3.SQLITE_OK if allowed else sqlite3.SQLITE_DENY
