"""How far a job of many like things is: a bar on a terminal, a line now and then elsewhere."""

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LINE_EVERY_S = 15.0


class CountBar:
    """Things done, things a second, and the time left where the number of things is known."""

    def __init__(self, console: Console, what: str, total: int | None, there: int = 0) -> None:
        """`there`: so many are done already; they do not count for the rate."""
        self._console = console
        self._what = what
        self._total = total
        self._there = self._count = there
        self._start_s = self._line_s = time.perf_counter()
        self._bar: Progress | None = None

    def __enter__(self) -> "CountBar":
        if self._console.is_terminal and not self._console.quiet:
            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[rate]}"))
            self._bar = Progress(
                *columns, TimeElapsedColumn(), TimeRemainingColumn(), console=self._console, transient=True
            )
            self._task = self._bar.add_task(self._words(), total=self._total, completed=self._count, rate="")
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def done(self) -> None:
        """One thing more is finished."""
        self._count += 1
        if self._bar is not None:
            self._bar.update(
                self._task, completed=self._count, description=self._words(), rate=f"{self.per_second:.1f} a second"
            )
        elif time.perf_counter() - self._line_s > LINE_EVERY_S:
            self._line_s = time.perf_counter()
            self._console.print(f"{self._words()}, {self.per_second:.1f} a second", markup=False)

    @property
    def per_second(self) -> float:
        """Things finished a second since this job began; 0 before the first."""
        return (self._count - self._there) / max(time.perf_counter() - self._start_s, 1e-9)

    def _words(self) -> str:
        of = "" if self._total is None else f" of {self._total}"
        return f"{self._count}{of} {self._what}"
