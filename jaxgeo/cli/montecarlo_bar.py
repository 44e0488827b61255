"""How far a Monte-Carlo study is: a bar on a terminal, a line now and then elsewhere."""

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LINE_EVERY_S = 15.0


class SessionBar:
    """Sessions done, sessions a second and the time left, on stderr; nothing when quiet."""

    def __init__(self, total: int, devices: str, quiet: bool = False) -> None:
        self._total = total
        self._devices = devices
        self._console = Console(file=sys.stderr, quiet=quiet, highlight=False, soft_wrap=True)
        self._count = self._before = 0
        self._start_s = self._line_s = time.perf_counter()
        self._bar: Progress | None = None

    def __enter__(self) -> "SessionBar":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        if kind is None and self._count > self._before:
            self._console.print(self._line(), markup=False)

    def begin(self, there: int) -> None:
        """Start the clock; so many sessions are there already."""
        self._count = self._before = there
        self._start_s = self._line_s = time.perf_counter()
        if there:
            self._console.print(f"going on: {there} of {self._total} simulated sessions are there", markup=False)
        if self._console.is_terminal and there < self._total:
            self._bar = Progress(
                TextColumn("simulated sessions"),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}"),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                console=self._console,
                transient=True,
            )
            self._task = self._bar.add_task("", total=self._total, completed=there, rate="compiling")
            self._bar.start()

    def done(self, more: int) -> None:
        """So many sessions more are finished."""
        if self._count == self._before:  # compiling is over: a rate that has it in says nothing of the time left
            self._line_s = time.perf_counter()
        self._count += more
        if self._bar is not None:
            self._bar.update(self._task, completed=self._count, rate=self._rate())
        elif time.perf_counter() - self._line_s > LINE_EVERY_S:
            self._line_s = time.perf_counter()
            self._console.print(self._line(), markup=False)

    def warn(self, text: str) -> None:
        """Say it above the bar, even when quiet."""
        print(f"warning: {text}", file=sys.stderr)

    def _per_second(self) -> float:
        return (self._count - self._before) / max(time.perf_counter() - self._start_s, 1e-9)

    def _rate(self) -> str:
        return f"{self._per_second():.1f} a second"

    def _line(self) -> str:
        left_s = (self._total - self._count) / max(self._per_second(), 1e-9)
        took_s = time.perf_counter() - self._start_s
        return (
            f"{self._count} of {self._total} simulated sessions, {self._rate()} on {self._devices}, {took_s:.0f} s"
            + (f", {left_s:.0f} s left" if self._count < self._total else "")
        )
