"""A campaign's folder: one file a finished session, under its key; whole or not there, so that none counts twice."""

import contextlib
import dataclasses
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import atomic_path

ROWS, SESSIONS = "rows", "sessions"
Status = Literal["ok", "failed", "timeout", "lost"]
# What the session itself gave stands; a worker that died, or a time limit, may be another's fault the next time.
FINAL: tuple[Status, ...] = ("ok", "failed")
# A row is a few kilobytes: nobody writes at one for longer.
WRITTEN_WITHIN_S = 5.0


@dataclasses.dataclass(frozen=True)
class SessionRow:
    """What became of one session.

    Attributes:
        key: of the session; `run` of the command that computed it.
        status: ok; failed, for what `message` says; timeout; lost, with its worker.
        exit_code: what `jaxgeo run` would have returned: 0, 2 bad input, 3 no estimate, 1 a fault of jaxgeo.
        attempts: times that a worker began with it, in that run; `seconds` of the last.
        trajectories: figures of each as in metrics.json; empty where it failed.
        odometry: kind of each trajectory; `learned` of each, what the sessions' common noise is pooled from.
        versions: that computed it; `outputs` whether its own files were written.
    """

    key: str
    run: str
    status: Status
    exit_code: int
    message: str
    attempts: int
    seconds: float
    trajectories: dict[str, dict[str, Any]] = dataclasses.field(default_factory=dict)
    odometry: dict[str, str] = dataclasses.field(default_factory=dict)
    learned: dict[str, dict[str, Any]] = dataclasses.field(default_factory=dict)
    versions: dict[str, str] = dataclasses.field(default_factory=dict)
    outputs: bool = False


def read_row(folder: Path, key: str) -> SessionRow | None:
    """The row of a session; None where there is none, or none that can be read."""
    try:
        content = json.loads(_row_path(folder, key).read_text(encoding="utf-8"))
        row = SessionRow(**content)
    except (OSError, ValueError, TypeError):  # not there, or not ours: computed anew
        return None
    return row if row.key == key else None


def write_row(folder: Path, row: SessionRow) -> None:
    """Put the row in place, whole, and forget its attempts.

    Raises:
        InputError, OSError: the folder cannot be written to.
    """
    with atomic_path(_row_path(folder, row.key)) as temporary:
        temporary.write_text(json_text(vars(row), indent=None), encoding="utf-8", newline="\n")
    _attempts_path(folder, row.key).unlink(missing_ok=True)


def forget_row(folder: Path, key: str) -> None:
    """Remove the row, if there is one: the session is to be computed anew."""
    _row_path(folder, key).unlink(missing_ok=True)


def remove_torn(folder: Path) -> None:
    """Remove what killed workers left of rows; what may be written at this moment stays, and what cannot be removed."""
    before_s = time.time() - WRITTEN_WITHIN_S
    for path in (folder / ROWS).glob(".*.tmp.*"):
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < before_s:
                path.unlink()


def begin_attempt(folder: Path, key: str, run: str) -> int:
    """Note that a worker begins with the session; how often one has, in this run."""
    count = attempts_begun(folder, key, run) + 1
    with atomic_path(_attempts_path(folder, key)) as temporary:
        temporary.write_text(json_text({"run": run, "count": count}, indent=None), encoding="utf-8")
    return count


def attempts_begun(folder: Path, key: str, run: str) -> int:
    """How often a worker has begun with the session in this run, without its row."""
    try:
        noted: Mapping[str, Any] = json.loads(_attempts_path(folder, key).read_text(encoding="utf-8"))
        return int(noted["count"]) if noted["run"] == run else 0
    except (OSError, ValueError, TypeError, KeyError):
        return 0


def _row_path(folder: Path, key: str) -> Path:
    return folder / ROWS / f"{key}.json"


def _attempts_path(folder: Path, key: str) -> Path:
    return folder / ROWS / f"{key}.attempts"
