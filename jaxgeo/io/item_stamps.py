"""When the scans or images of a folder were taken: by a table, by a list, by their names, or by a rate."""

import dataclasses
import itertools
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import ScanError
from jaxgeo.io.frames.folder import natural_key
from jaxgeo.io.frames.stamp_table import read_stamp_table
from jaxgeo.io.frames.stamps import check_rate, number_of, seconds, stamp_in_name, unit_of
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.item_source import OnBad, raised_as
from jaxgeo.io.named_file import is_there
from jaxgeo.io.text_table import TextTable, read_table, text_column


@dataclasses.dataclass(frozen=True)
class StampedFile:
    """A file of a folder, its stamp, and where that comes from (for messages)."""

    stamp_s: float
    file: Path
    place: str


def check_stamp_choice(
    path: str | Path, stamps: str | Path | None, rate_hz: float | None, start_s: float | None
) -> None:
    """Refuse arguments that contradict each other.

    Raises:
        ScanError: both `stamps` and `rate_hz`, `start_s` alone, or numbers that cannot be.
    """
    with raised_as(ScanError):
        check_rate(path, rate_hz, start_s)
    if stamps is not None and rate_hz is not None:
        raise ScanError(f"{path}: both `stamps` and `rate_hz` say when it was recorded. Give one of them.")
    if start_s is not None and rate_hz is None:
        raise ScanError(f"{path}: `start_s` is the stamp of the first one at `rate_hz`: give that too.")


def stamped_files(
    folder: Path,
    files: Sequence[Path],
    *,
    stamps: str | Path | None,
    rate_hz: float | None,
    start_s: float | None,
    noun: str,
    on_bad: OnBad,
) -> list[StampedFile]:
    """The files by stamp.

    Args:
        folder: from which the names in a table count, or else from the table's own folder or the files'.
        files: what the folder holds.
        stamps: a table of stamps and file names (`read_stamp_table`), or a list of one stamp a line, in the natural
            order of the names (2 before 10).
        rate_hz, start_s: files a second in that order, the first at `start_s` (default 0).
            Without these and without `stamps`, the names hold the stamps (`stamp_in_name`).
        noun: what a file holds, for messages.
        on_bad: with `skip`, files that the table names and that are missing are kept, to be met when read.

    Raises:
        ScanError: table, list or names do not fit the files; stamps that do not increase; two files of one stamp.

    Warns:
        InputWarning: of files that have no stamp; they are left out.
    """
    files = sorted(files, key=lambda file: natural_key(file.name))
    if rate_hz is not None:
        taken_s = rate_stamps(len(files), rate_hz, start_s)
        return [StampedFile(float(at), file, str(file)) for at, file in zip(taken_s, files, strict=True)]
    if stamps is None:
        rows = _of_names(folder, files, noun)
    elif is_stamp_list(stamps):
        taken_s, place = listed_stamps(folder, len(files), stamps, noun)
        return [StampedFile(float(at), file, place(i)) for i, (at, file) in enumerate(zip(taken_s, files, strict=True))]
    else:
        rows = _of_table(folder, files, stamps, noun, on_bad)
    rows.sort(key=lambda row: row.stamp_s)
    for one, other in itertools.pairwise(rows):
        if one.stamp_s == other.stamp_s:
            raise ScanError(
                f"{other.place}: {other.file.name} has the stamp {other.stamp_s!r} s of {one.file.name} ({one.place}). "
                "Mend or remove one of them."
            )
    return rows


def rate_stamps(n: int, rate_hz: float, start_s: float | None) -> Float[np.ndarray, "n"]:
    """Stamps of n items at a rate."""
    return (start_s or 0.0) + np.arange(n) / rate_hz


def is_stamp_list(path: str | Path) -> bool:
    """Whether the file has one column, stamps, rather than stamps and names.

    Raises:
        ScanError: it cannot be read as a table at all.
    """
    return read_table(path, error=ScanError).n_columns == 1


def listed_stamps(
    path: str | Path, n: int, stamps: str | Path, noun: str
) -> tuple[Float[np.ndarray, "n"], Callable[[int], str]]:
    """Stamps of n items from a file of one stamp a line, seconds or nanoseconds, and the place of each.

    Raises:
        ScanError: another number of stamps, or they do not increase.
    """
    table = read_table(stamps, error=ScanError)
    if table.n_columns != 1:
        raise ScanError(f"{table.place(0)}: {table.n_columns} columns, expected one stamp a line.")
    if len(table) != n:
        raise ScanError(
            f"{path} has {n} {noun}s, but {stamps} has {len(table)} stamps; expected one stamp for each. Is this the "
            "list of another recording?"
        )
    return increasing_stamps(table, 0), table.place


def increasing_stamps(table: TextTable, column: int) -> Float[np.ndarray, "n"]:
    """The stamps in a column, seconds or nanoseconds, as float64 seconds.

    Raises:
        ScanError: with line: no number, of the size of neither unit, or not after the one before.
    """
    texts = text_column(table, column)
    numbers = [number_of(text) for text in texts]
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        row = numbers.index(None)
        raise ScanError(f"{table.place(row)}: stamp {texts[row][:40]!r}, expected a number: mend or remove the row.")
    with raised_as(ScanError):
        unit = unit_of(known, str(table.path))
    stamp_s = np.array([seconds(number, unit) for number in known])
    check_increasing_stamps(stamp_s, table.place)
    return stamp_s


def check_increasing_stamps(stamp_s: Float[np.ndarray, "n"], place: Callable[[int], str]) -> None:
    """Refuse stamps that do not increase, naming the first two.

    Raises:
        ScanError: at the place of the later one.
    """
    wrong = ~(np.diff(stamp_s) > 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        before, after = float(stamp_s[row]), float(stamp_s[row + 1])
        raise ScanError(
            f"{place(row + 1)}: stamp {after!r} s after {before!r} s ({place(row)}), expected stamps that increase. "
            "Mend the stamps, or were two recordings put together?"
        )


def _of_names(folder: Path, files: Sequence[Path], noun: str) -> list[StampedFile]:
    stamped = [(stamp_in_name(file), file) for file in files]
    rows = [StampedFile(stamp_s, file, str(file)) for stamp_s, file in stamped if stamp_s is not None]
    if not rows:
        raise ScanError(
            f"{files[0]}: the name holds no stamp: expected seconds with decimals (1305031102.175304) or nanoseconds "
            f"(18 or 19 digits) at its end. Give `stamps` (one a line, or stamp_s,file), or `rate_hz` for {noun}s a "
            "second."
        )
    _warn_of_unstamped(
        folder, [file for at, file in stamped if at is None], len(files), noun, "have none in their name"
    )
    return rows


def _of_table(folder: Path, files: Sequence[Path], stamps: str | Path, noun: str, on_bad: OnBad) -> list[StampedFile]:
    with raised_as(ScanError):
        table = read_stamp_table(stamps)
    rows, missing = [], []
    for row in table:
        places = [place / row.file for place in (folder, Path(stamps).parent, *{file.parent for file in files})]
        file = next((place for place in places if is_there(place)), None)
        if file is None:
            missing.append(row)
        rows.append(StampedFile(row.stamp_s, file or places[0], row.place))
    if missing and (on_bad == "raise" or len(missing) == len(rows)):
        raise ScanError(
            f"{missing[0].place}: names {missing[0].file!r:.80}, which is not in {folder}; {len(missing)} of the "
            f"{len(rows)} rows name missing files. Is this the table of another folder? Copy the files, or remove "
            "their rows."
        )
    named: dict[Path, StampedFile] = {}
    for row in rows:
        other = named.setdefault(row.file, row)
        if other is not row:
            raise ScanError(f"{row.place}: {row.file} is named a second time, first in {other.place}. Keep one row.")
    left_out = [file for file in files if file not in named]
    _warn_of_unstamped(folder, left_out, len(files), noun, f"are not in {stamps}")
    return rows


def _warn_of_unstamped(folder: Path, without: list[Path], total: int, noun: str, why: str) -> None:
    if without:
        warnings.warn(
            f"{folder}: stamps are missing for {len(without)} of {total} {noun}s, which {why} and are left out; the "
            f"first is {without[0].name}.",
            InputWarning,
            stacklevel=6,
        )
