"""Bad input through the command line: the exit code, one message that names place and mend, and nothing written."""

import dataclasses
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.small_session import write_small_session

import jaxgeo.io.atomic
from jaxgeo.cli.main import main

Spoil = Callable[[Path], None]

JUNK = bytes(range(128, 256)) + b"\0\1\2\n" * 20


def replace(file: str, old: str, new: str) -> Spoil:
    """Text that must be there, replaced once."""

    def spoil(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))

    return spoil


def content(file: str, data: str | bytes) -> Spoil:
    return lambda folder: (folder / file).write_bytes(data if isinstance(data, bytes) else data.encode())


def row(file: str, line: int, change: Callable[[list[str]], list[str]]) -> Spoil:
    """One line, counted from 1, its cells changed."""

    def spoil(folder: Path) -> None:
        lines = (folder / file).read_text().split("\n")
        mark = "," if file.endswith("csv") else " "
        lines[line - 1] = mark.join(change(lines[line - 1].split(mark)))
        (folder / file).write_text("\n".join(lines))

    return spoil


def cell(file: str, line: int, column: int, value: str) -> Spoil:
    return row(file, line, lambda cells: [*cells[:column], value, *cells[column + 1 :]])


def lines(file: str, change: Callable[[list[str]], list[str]]) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).write_text("\n".join(change((folder / file).read_text().splitlines())) + "\n")

    return spoil


def head(file: str, count: int) -> Spoil:
    return lines(file, lambda found: found[:count])


def folder_in_place(file: str) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).unlink()
        (folder / file).mkdir()

    return spoil


def shifted(file: str, offset_s: float) -> Spoil:
    """Another clock."""

    def later(line: str) -> str:
        stamp, rest = line.split(",", 1)
        return line if stamp == "stamp_s" else f"{float(stamp) + offset_s},{rest}"

    return lines(file, lambda found: [later(line) for line in found])


def both(*spoils: Spoil) -> Spoil:
    def spoil(folder: Path) -> None:
        for one in spoils:
            one(folder)

    return spoil


def nothing(folder: Path) -> None:
    del folder


def on_a_line(folder: Path) -> None:
    """Surveyed positions, and what was seen, moved onto one line (E grows, N and h stay)."""
    text = (folder / "truth.yaml").read_text()
    rows = [5, 35, 65, 95, 125, 155, 185]
    for file in ("truth.tum", "icp.kitti"):
        found = [line.split() for line in (folder / file).read_text().splitlines()]
        at = 1 if file == "truth.tum" else 3
        step = 1 if file == "truth.tum" else 4
        for k, number in enumerate(rows):
            for axis in (1, 2):
                found[number][at + axis * step] = found[rows[0]][at + axis * step]
            found[number][at] = str(float(found[rows[0]][at]) + 10.0 * (k % 6))
        (folder / file).write_text("\n".join(map(" ".join, found)) + "\n")
    (folder / "truth.yaml").write_text(text)


@dataclasses.dataclass(frozen=True)
class Case:
    """`session` is the config's name, `says` what the message must match, `set_` overrides."""

    id: str
    session: str
    spoil: Spoil
    code: int
    says: tuple[str, ...]
    set_: tuple[str, ...] = ()


def set_case(id: str, session: str, override: str, *says: str, code: int = 2) -> Case:
    return Case(id, session, nothing, code, says, (override,))
