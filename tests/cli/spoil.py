"""Ways to spoil a session's files."""

from collections.abc import Callable
from pathlib import Path

Spoil = Callable[[Path], None]
"""Changes files in the session's folder."""

JUNK = bytes(range(128, 256)) + b"\0\1\2\n" * 20
BOMB = "a: &a [x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdef", "bcdefg", strict=True)
)


def nothing(folder: Path) -> None:
    """The files are sound: `--set` is not."""
    del folder


def content(file: str, data: str | bytes) -> Spoil:
    return lambda folder: (folder / file).write_bytes(data if isinstance(data, bytes) else data.encode())


def replace(file: str, old: str, new: str) -> Spoil:
    """Text that must be there, replaced once."""

    def spoil(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))

    return spoil


def lines(file: str, change: Callable[[list[str]], list[str]]) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).write_text("\n".join(change((folder / file).read_text().splitlines())) + "\n")

    return spoil


def row(file: str, line: int, change: Callable[[list[str]], list[str]]) -> Spoil:
    """The cells of one line, counted from 1."""
    mark = "," if file.endswith("csv") else " "
    return lines(file, lambda old: [*old[: line - 1], mark.join(change(old[line - 1].split(mark))), *old[line:]])


def columns(file: str, change: Callable[[list[str]], list[str]]) -> Spoil:
    """The cells of every line of a comma-separated file, its header's too."""
    return lines(file, lambda old: [",".join(change(line.split(","))) for line in old])


def cell(file: str, line: int, column: int, value: str) -> Spoil:
    return row(file, line, lambda cells: [*cells[:column], value, *cells[column + 1 :]])


def missing(file: str) -> Spoil:
    return lambda folder: (folder / file).unlink()


def folder_instead(file: str) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).unlink()
        (folder / file).mkdir()

    return spoil


def later(file: str, offset_s: float) -> Spoil:
    """Another clock: the stamps of a comma-separated file moved."""

    def move(cells: list[str]) -> list[str]:
        return cells if cells[0] == "stamp_s" else [str(float(cells[0]) + offset_s), *cells[1:]]

    return columns(file, move)


def on_a_line(folder: Path) -> None:
    """The visited poses of truth and odometry on one line: E grows, N and h stay."""
    visited = [5, 35, 65, 95, 125, 155, 185]
    for file, at in (("truth.tum", (1, 2, 3)), ("icp.kitti", (3, 7, 11))):
        rows = [line.split() for line in (folder / file).read_text().splitlines()]
        first = rows[visited[0]]
        for visit, number in enumerate(visited):
            rows[number][at[0]] = str(float(first[at[0]]) + 10.0 * (visit % 6))
            rows[number][at[1]], rows[number][at[2]] = first[at[1]], first[at[2]]
        (folder / file).write_text("\n".join(map(" ".join, rows)) + "\n")
