"""What a worker of a campaign does: one session to one row file, whatever becomes of it."""

import contextlib
import dataclasses
import functools
import json
import os
import platform
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jaxgeo.cli.campaign_rows import FINAL, SESSIONS, SessionRow, Status, begin_attempt, read_row, write_row
from jaxgeo.config import dump_config
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import InputError, JaxgeoError

LIBRARIES = ("jaxgeo", "jax", "jaxlib", "optimistix", "lineax", "equinox", "numpy", "scipy", "pyproj")
INTERNAL_ERROR = 1
NO_ESTIMATE = 3
# Of what is learned, what pooling needs.
_POOLED_KEYS = ("kind", "observations", "n_contrasts", "models", "sigmas")


@dataclasses.dataclass(frozen=True)
class Task:
    """One session for one worker.

    Attributes:
        config: of the session; None where it was refused, with the message `refused`.
        out: the campaign's folder, the same for every machine; `folder` the session's in it.
        key, run: of the session, of the command.
        retries: how often it may begin again after its worker was lost.
        limit_s: seconds that it may take; None: no limit.
        evaluate, outputs: write what `jaxgeo evaluate` or `jaxgeo run` writes.
        versions: of the command; a worker with others is refused.
    """

    config: SessionConfig | None
    refused: str
    out: Path
    folder: str
    key: str
    run: str
    retries: int
    limit_s: float | None
    evaluate: bool
    outputs: bool
    versions: dict[str, str]


def library_versions() -> dict[str, str]:
    """Of what the numbers depend on, here."""
    return dict(_versions())


@functools.cache  # looked up on disk: 5 ms, for every session
def _versions() -> dict[str, str]:
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


def finished(task: Task) -> SessionRow | None:
    """The session's row, where it is done: by this run, or for good and with the files asked for."""
    row = read_row(task.out, task.key)
    if row is None or row.run == task.run:
        return row
    there = not (task.outputs or task.evaluate) or row.status != "ok" or row.outputs
    return row if row.status in FINAL and there else None


def run_task(task: Task) -> Status:
    """Compute the session's row and write it, unless it is there; the same task may come to several workers.

    Raises:
        InputError: this worker has other versions than the command.
        InputError, OSError: the row cannot be written.
    """
    done = finished(task)
    if done is not None:
        return done.status
    refuse_other_versions(library_versions(), task.versions)
    attempt = begin_attempt(task.out, task.key, task.run)
    if attempt > task.retries + 1:
        write_row(task.out, lost_row(task, attempt - 1))
        return "lost"
    started = time.perf_counter()
    with _time_limit(task, attempt) as in_time:
        row = _attempted(task, attempt, started)
        if not in_time():  # the limit is about to end this process
            time.sleep(60.0)
    write_row(task.out, row)
    return row.status


def lost_row(task: Task, attempts: int) -> SessionRow:
    """Of a session whose worker died each time."""
    message = (
        f"its worker was lost {attempts} times; expected it to end. Out of memory? Give workers more, or run it alone "
        "with 'jaxgeo run'."
    )
    return SessionRow(task.key, task.run, "lost", NO_ESTIMATE, message, attempts, 0.0, versions=library_versions())


def _attempted(task: Task, attempt: int, started: float) -> SessionRow:
    versions = library_versions()

    def row(status: Status, code: int, message: str, **found: Any) -> SessionRow:
        seconds = time.perf_counter() - started
        return SessionRow(task.key, task.run, status, code, message, attempt, seconds, versions=versions, **found)

    try:
        if task.config is None:
            return row("failed", InputError.exit_code, task.refused)
        return row("ok", 0, "", **_figures(task, task.config))
    except JaxgeoError as error:
        return row("failed", error.exit_code, str(error))
    except (OSError, MemoryError) as error:  # the machine's fault: another time it may go well
        place = f"{error.filename}: " if isinstance(error, OSError) and error.filename else ""
        return row("lost", NO_ESTIMATE, f"{place}{getattr(error, 'strerror', None) or error or 'out of memory'}")
    except Exception as error:  # whatever it was costs this session only, and is said in its row
        return row("failed", INTERNAL_ERROR, f"{type(error).__name__}: {error}. This is a fault of jaxgeo.")


def refuse_other_versions(here: dict[str, str], asked: dict[str, str]) -> None:
    """Rows of one campaign come from the same code.

    Raises:
        InputError: names the first that differs.
    """
    for name, wanted in asked.items():
        if here.get(name) != wanted:
            raise InputError(
                f"worker on {platform.node()}: {name} {here.get(name)}, the command has {wanted}. Install the same "
                "versions on all machines."
            )


def _figures(task: Task, config: SessionConfig) -> dict[str, Any]:
    """Run the session; what its row holds."""
    # Only here: the command lists, counts and resumes sessions without loading JAX's programs.
    from jaxgeo.cli.run import keep_compiled_programs
    from jaxgeo.precision import let_programs_go

    keep_compiled_programs()
    folder = task.out / SESSIONS / task.folder
    metrics, noise = _evaluated(config, folder) if task.evaluate else _run(config, folder, task.outputs)
    let_programs_go()
    learned = {name: stages["learned"] for name, stages in noise.items() if stages.get("learned") is not None}
    return {
        "trajectories": metrics["trajectories"],
        "odometry": {name: source.odometry for name, source in config.trajectories.items()},
        "learned": {
            name: {key: found[key] for key in _POOLED_KEYS} | {"correlation_m": found["ensemble"]["correlation_m"]}
            for name, found in learned.items()
        },
        "outputs": task.outputs or task.evaluate,
    }


def _run(config: SessionConfig, folder: Path, outputs: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    from jaxgeo.cli.progress import Progress
    from jaxgeo.cli.session import run_session
    from jaxgeo.export.json_text import json_ready
    from jaxgeo.export.metrics import metrics_dict
    from jaxgeo.export.session_files import write_session

    with Progress(quiet=True) as progress:
        result = run_session(config, progress, out=folder)
    if outputs:
        write_session(result, folder)
    return metrics_dict(result), json_ready({name: t.noise for name, t in result.trajectories.items()})


def _evaluated(config: SessionConfig, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """As `jaxgeo evaluate` does it, and read back."""
    from jaxgeo.cli.evaluate import evaluate_configs

    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "config.yaml"
        path.write_text(dump_config(config), encoding="utf-8")
        evaluate_configs([path], folder, [], quiet=True)
    metrics, noise = (
        json.loads((folder / name).read_text(encoding="utf-8")) for name in ("metrics.json", "noise.json")
    )
    return metrics, noise["trajectories"]


@contextlib.contextmanager
def _time_limit(task: Task, attempt: int) -> Iterator[Callable[[], bool]]:
    """End this process where the session takes longer, its row written; its nanny starts another worker.

    Compiled code cannot be interrupted, and a thread not be killed: the process is what there is to end. What the block
    gets says, once, whether the session was in time; after that the limit is off.
    """
    first = threading.Lock()
    if task.limit_s is None:
        yield lambda: True
        return
    message = f"stopped after the time limit of {task.limit_s:g} s; raise --time-limit, or run it alone"

    def stop() -> None:
        if not first.acquire(blocking=False):
            return
        try:
            write_row(
                task.out,
                SessionRow(
                    task.key, task.run, "timeout", NO_ESTIMATE, message, attempt, float(task.limit_s or 0.0),
                    versions=library_versions(),
                ),
            )  # fmt: skip
        finally:
            os._exit(NO_ESTIMATE)

    timer = threading.Timer(task.limit_s, stop)
    timer.daemon = True
    timer.start()
    try:
        yield lambda: first.acquire(blocking=False)
    finally:
        timer.cancel()
