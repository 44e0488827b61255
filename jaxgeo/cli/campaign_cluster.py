"""Tasks on a Dask cluster: worker processes of this machine, or a scheduler that is there already."""

import contextlib
import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from jaxgeo.cli.campaign_rows import Status, attempts_begun, write_row
from jaxgeo.cli.campaign_task import Task, finished, lost_row, run_task
from jaxgeo.errors import InputError
from jaxgeo.processes import interrupts_kept

if TYPE_CHECKING:
    from distributed import Client

ANSWER_WITHIN_S = 20.0
# Retries are counted in the campaign's folder, for each session by itself; Dask's own count is to stay out of the way.
_NEVER = 1_000_000
_LOGGERS = (
    "distributed",
    *(f"distributed.{part}" for part in ("client", "core", "nanny", "scheduler", "utils", "worker")),
)


def need_dask() -> None:
    """Refuse at once where it is missing.

    Raises:
        InputError: says how to install it.
    """
    try:
        import distributed  # noqa: F401
        from dask import config
    except ImportError as error:
        raise InputError(
            f"jaxgeo campaign needs dask and distributed ({error}): pip install 'jaxgeo[campaign]'"
        ) from None
    # A worker's loop that waits for a compiler is no news.
    config.set({"distributed.admin.tick.limit": "10m", "distributed.scheduler.allowed-failures": _NEVER})


# Of this machine's workers. Dask has them give every freed array back to the system, to fetch it again for the next
# session: 25 000 page faults and a fifth of its processor time. Nobody reads Dask's profile of them.
_WORKERS = {
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    "distributed.worker.profile.enabled": False,
}
# Threads of XLA: one for each worker. Sessions are too small to be shared out (with 20 000 poses three threads are no
# faster than one, with 128 slower), and each worker would start as many as the machine has cores.
_ENVIRONMENT = {"NPROC": "1"}


@contextlib.contextmanager
def campaign_client(workers: int, scheduler: str | None) -> "Iterator[Client]":
    """A client of `scheduler`, or of so many new processes with one thread each, which end with the block.

    Raises:
        InputError: no scheduler answers, or no worker starts.
    """
    need_dask()
    from dask import config
    from distributed import Client, LocalCluster

    for name in _LOGGERS:  # what matters of it we say ourselves, in one line
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=ANSWER_WITHIN_S)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no Dask scheduler answers there within {ANSWER_WITHIN_S:g} s "
                f"({type(error).__name__}: {error}); expected an address such as tcp://HOST:8786"
            ) from None
        with client:
            if not client.scheduler_info(n_workers=-1)["workers"]:
                print(f"warning: {scheduler} has no worker yet: waiting for one", file=sys.stderr)
            yield client
        return
    # A port that is free, for a page of Dask's own; sessions may need all the memory that there is.
    options: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "memory_limit": None}
    options |= {"n_workers": workers, "threads_per_worker": 1, "processes": True, "silence_logs": logging.CRITICAL}
    options["env"] = _ENVIRONMENT
    try:
        # The thread that starts the workers, now and after one was lost, begins here too.
        with config.set(_WORKERS), interrupts_kept():
            cluster = LocalCluster(**options)
    except RuntimeError as error:
        raise InputError(
            f"--workers {workers}: no cluster starts on this machine ({error}); try fewer, or --scheduler"
        ) from None
    with cluster, Client(cluster) as client:
        yield client


def run_tasks(client: "Client", tasks: Sequence[Task], done: Callable[[Task, Status], None]) -> None:
    """Every task to its row, in any order; `done` is called after each.

    Raises:
        InputError: rows cannot be written, a worker has other versions, or the scheduler is gone.
    """
    from distributed import KilledWorker, as_completed

    futures = client.map(run_task, tasks, pure=False, key=[f"{task.folder}-{task.key[:12]}" for task in tasks])
    of = {future.key: task for future, task in zip(futures, tasks, strict=True)}
    for future in as_completed(futures):
        task = of[future.key]
        if future.status == "finished":
            done(task, future.result())
        elif future.status == "error" and isinstance(future.exception(), KilledWorker):
            done(task, _lost(task))
        else:
            raise _stopped(future)
        future.release()


def _lost(task: Task) -> Status:
    """Given up by a scheduler with a count of its own; a worker that it thought dead may have written the row."""
    row = finished(task)
    if row is None:
        row = lost_row(task, attempts_begun(task.out, task.key, task.run))
        write_row(task.out, row)
    return row.status


def _stopped(future: Any) -> Exception:
    if future.status != "error":
        return InputError(
            "the Dask scheduler is gone, or was told to forget the campaign's sessions; the same command goes on from "
            "what is done"
        )
    error = future.exception()
    if isinstance(error, InputError | OSError):
        return error
    return InputError(
        f"a worker cannot run sessions ({type(error).__name__}: {error}). Is jaxgeo installed where the workers run, "
        "in the same version?"
    )
