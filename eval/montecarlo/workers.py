"""Sessions simulated in processes of their own, ahead of the devices that work on them."""

import contextlib
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future

from eval.montecarlo.sessions import SessionArrays, sessions_arrays
from eval.montecarlo.settings import StudySettings
from jaxgeo.processes import WorkerPool

# Sessions a task: some tenths of a second, so that handing it over costs nothing.
TASK = 4


@contextlib.contextmanager
def simulated(
    settings: StudySettings, sessions: Sequence[int], workers: int, ahead: int
) -> Iterator[Iterator[SessionArrays]]:
    """These sessions in their order, at most about `ahead` of them waiting; with no worker, in this process."""
    if workers == 0:
        yield (arrays for i in sessions for arrays in sessions_arrays(settings, (i,)))
        return
    pool = WorkerPool(min(workers, -(-len(sessions) // TASK)), _prepare)
    try:
        yield _in_order(pool, settings, sessions, ahead)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _in_order(
    pool: WorkerPool, settings: StudySettings, sessions: Sequence[int], ahead: int
) -> Iterator[SessionArrays]:
    waiting: deque[Future[list[SessionArrays]]] = deque()
    tasks = iter([tuple(sessions[i : i + TASK]) for i in range(0, len(sessions), TASK)])
    for task in tasks:
        waiting.append(pool.submit(sessions_arrays, settings, task))
        if len(waiting) * TASK >= ahead:
            yield from waiting.popleft().result()
    while waiting:
        yield from waiting.popleft().result()


def _prepare() -> None:
    """A worker simulates on the CPU."""
    import jax

    jax.config.update("jax_platforms", "cpu")
