"""One pass of a campaign: what was asked, a task for each session, and their rows."""

import contextlib
import dataclasses
import sys
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jaxgeo.cli.campaign_cluster import run_tasks
from jaxgeo.cli.campaign_rows import ROWS, SessionRow, forget_row, read_row
from jaxgeo.cli.campaign_sessions import CampaignSession
from jaxgeo.cli.campaign_task import Task, finished
from jaxgeo.cli.progress import Progress
from jaxgeo.config.inputs import TrajectoryInput
from jaxgeo.errors import InputError

if TYPE_CHECKING:
    from jaxgeo.cli.campaign_cluster import Client


@dataclasses.dataclass(frozen=True)
class CampaignAsked:
    """The command's options."""

    sessions: Sequence[str]
    out: Path
    workers: int
    scheduler: str | None = None
    retries: int = 2
    limit_s: float | None = None
    overrides: Sequence[str] = ()
    evaluate: bool = False
    outputs: bool = False
    pool: bool = False
    pool_by: str | None = None
    fresh: bool = False
    quiet: bool = False


def first_tasks(
    asked: CampaignAsked, sessions: Sequence[CampaignSession], out: Path, versions: dict[str, str]
) -> list[Task]:
    """A task for every session, all of one run."""
    run = uuid.uuid4().hex
    return [
        Task(
            config=session.config,
            refused=session.refused,
            out=out,
            folder=session.folder,
            key=session.key,
            run=run,
            retries=asked.retries,
            limit_s=asked.limit_s,
            evaluate=asked.evaluate,
            outputs=asked.outputs,
            versions=versions,
        )
        for session in sessions
    ]


def run_pass(tasks: Sequence[Task], client: "Callable[[], Client]", progress: Progress, what: str, fresh: bool) -> int:
    """Run the tasks that have no row yet, the longest first; how many those were.

    Raises:
        InputError: rows cannot be written, or the cluster failed; what was done stays done.
    """
    if fresh:
        for task in tasks:
            forget_row(task.out, task.key)
    missing = [task for task in tasks if finished(task) is None]
    there = len(tasks) - len(missing)
    if there:
        progress.say(f"going on: {there} of {len(tasks)} {what} are done")
    if not missing:
        return 0
    try:
        with progress.count(what, len(tasks), there) as bar:
            run_tasks(client(), longest_first(missing), lambda *_: bar.done())
    except BaseException:
        done = sum(finished(task) is not None for task in tasks)
        print(f"stopped: {done} of {len(tasks)} {what} are done; the same command goes on from there", file=sys.stderr)
        raise
    return len(missing)


def longest_first(tasks: Sequence[Task]) -> list[Task]:
    """By the size of their trajectories' files; those of one size in the order given.

    A worker loads compiled programs for every new number of poses, for seconds, and lets those of before go when they
    fill its memory: sessions alike have to follow each other. And no long one should begin when all others are done.
    """
    return sorted(tasks, key=_trajectory_bytes, reverse=True)


def _trajectory_bytes(task: Task) -> int:
    """Of a trajectory that is still to be computed nothing is known, nor of a file that cannot be read."""
    total = 0
    for source in task.config.trajectories.values() if task.config is not None else ():
        with contextlib.suppress(OSError):
            total += source.file.stat().st_size if isinstance(source, TrajectoryInput) else 0
    return total


def rows_of(tasks: Sequence[Task]) -> list[SessionRow]:
    """Every task's row, read back.

    Raises:
        InputError: one is missing: its worker wrote elsewhere.
    """
    rows = []
    for task in tasks:
        row = read_row(task.out, task.key)
        if row is None:
            raise InputError(
                f"{task.out / ROWS}: no row of session {task.folder!r}, although a worker wrote it. Workers need the "
                "same folder under the same name: put --out on a file system that all machines share."
            )
        rows.append(row)
    return rows
