"""Worker processes that leave the keyboard's interrupt to their parent, and do not outlive it."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import resource_tracker
from typing import Any


@contextlib.contextmanager
def interrupts_kept() -> Iterator[None]:
    """Processes and threads that begin in this block never get Ctrl-C, which goes to all processes of a terminal.

    Not even while they start: a signal that is blocked stays blocked in what is started.
    """
    resource_tracker.ensure_running()  # with the first process it would begin here, and let interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class WorkerPool(ProcessPoolExecutor):
    """Fresh processes (a fork would copy the locks of JAX's and Open3D's threads), each prepared once."""

    def __init__(self, workers: int, prepare: Callable[..., None], arguments: tuple[Any, ...] = ()):
        super().__init__(workers, multiprocessing.get_context("spawn"), _begin, (prepare, arguments))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Processes begin when there is work for them."""
        with interrupts_kept():
            return super().submit(fn, *args, **kwargs)


def _begin(prepare: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_leave_with, args=(parent,), daemon=True).start()
    prepare(*arguments)


def _leave_with(parent: Any) -> None:  # multiprocessing names no type for it
    parent.join()
    os._exit(1)
