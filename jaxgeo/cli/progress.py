"""What the terminal shows while a session runs: one line a phase, with its time."""

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.status import Status

from jaxgeo.cli.count_bar import CountBar


class Progress:
    """Phases one after another, on stderr: a spinner on a terminal, plain lines elsewhere, nothing when quiet.

    Phases of a run, in order: read, and for each trajectory anchors, correct, learn, compare; then write.
    """

    def __init__(self, quiet: bool = False) -> None:
        self._console = Console(file=sys.stderr, quiet=quiet, highlight=False, soft_wrap=True)
        self._status: Status | None = None
        self._running = ""
        self._start_s = 0.0

    def phase(self, name: str, detail: str = "") -> None:
        """End the phase that runs, and begin this one; `detail` says on what (a trajectory, a file)."""
        self._end()
        self._running = f"{name} {detail}".strip()
        self._start_s = time.perf_counter()
        if self._console.is_terminal:
            self._status = self._console.status(self._running)
            self._status.start()

    def count(self, what: str, total: int | None, there: int = 0) -> CountBar:
        """A bar in the place of the phase's spinner: `what` is counted, `there` of `total` are done already."""
        self._stop_spinner()
        return CountBar(self._console, what, total, there)

    def say(self, text: str) -> None:
        """One line; nothing when quiet."""
        self._console.print(text, markup=False)

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._end()
        else:
            self._stop_spinner()

    def _end(self) -> None:
        self._stop_spinner()
        if self._running:
            self._console.print(f"{self._running:<32} {time.perf_counter() - self._start_s:6.2f} s", markup=False)
            self._running = ""

    def _stop_spinner(self) -> None:
        if self._status is not None:
            self._status.stop()
            self._status = None
