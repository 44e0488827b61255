"""Commands that are killed, terminated and interrupted at seeded moments of their whole run.

Each is killed again and again into the same folder of outputs, half of the moments counted from its start, half from
the first change of the outputs or of what lies beside them: there it writes. After every one the outputs must be whole,
no process of it may live on, and when at last it is left alone it must end well, with the results of a run that nobody
disturbed.
"""

import dataclasses
import os
import re
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks import fault_inputs as inputs
from benchmarks.fault_case import COMMAND, Change, Row, environment, first_line
from benchmarks.fault_files import RUN_RESULTS
from benchmarks.fault_whole import broken_files, changes, snapshot

SEED = 8
GONE_S = 30.0  # within which the processes of a killed command must be gone
LONGEST_S = 300.0
SIGNALS = {"kill -9": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "Ctrl-C": signal.SIGINT}
# What a command may return: killed; terminated or interrupted; or done before the signal came.
_CODES = {signal.SIGKILL: (-9, 0), signal.SIGTERM: (143, -15, 0), signal.SIGINT: (130, -2, 0)}
# Share of the duration before which an interrupt meets Python itself, not yet the command.
_FIRST_SHARE = {signal.SIGKILL: 0.02, signal.SIGTERM: 0.3, signal.SIGINT: 0.3}


@dataclasses.dataclass(frozen=True)
class Kill:
    """A command that is stopped at several moments.

    Attributes:
        name, inputs, arguments, results: as of a `Case`; the outputs are the folder `out`.
        signal: what stops it; an interrupt goes to all of its processes, as from a keyboard.
        moments: how many times.
        complete: the outputs hold all of `results` or none, as those of a command that writes them in one step do.
    """

    name: str
    inputs: Callable[[], Change]
    arguments: tuple[str, ...]
    results: tuple[str, ...]
    signal: signal.Signals
    moments: int
    complete: bool

    def row(self) -> Row:
        return stopped(self)


_COMMANDS: dict[str, tuple[Callable[[], Change], tuple[str, ...], tuple[str, ...], bool]] = {
    "run": (inputs.session, ("run", "poses.yaml", "--out", "out", "--quiet"), RUN_RESULTS, True),
    "campaign": (
        inputs.session,
        ("campaign", "poses.yaml", "corners.yaml", "stops.yaml", "--out", "out", "--workers", "2", "--quiet"),
        (),
        False,
    ),
    "study montecarlo": (
        inputs.session,
        (
            *("study", "montecarlo", "--out", "out", "--draws", "2", "--chunk", "1", "--poses", "64"),
            *("--regimes", "white", "--workers", "0", "--devices", "1", "--quiet"),
        ),
        ("sessions.csv",),
        False,
    ),
}
_HASH = re.compile(r"[0-9a-f]{64}")
_MOMENTS = {"kill -9": (10, 4), "SIGTERM": (5, 2), "Ctrl-C": (5, 2)}


def kills(quick: bool) -> Iterator[Kill]:
    """Every command with every signal; fewer moments where it is to be quick."""
    for command, (make, arguments, results, complete) in _COMMANDS.items():
        for words, number in SIGNALS.items():
            moments = _MOMENTS[words][quick]
            yield Kill(f"{words}: {command}", make, arguments, results, number, moments, complete)


def stopped(kill: Kill) -> Row:
    """Stop a command at every moment, then leave it alone, and check what it left each time."""
    started = time.perf_counter()
    random = np.random.default_rng(SEED)
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        place, sound = Path(name) / "work", Path(name) / "sound"
        for folder in (place, sound):
            folder.mkdir()
            kill.inputs()(folder)
        whole_s, write_s = _durations(kill, sound)
        before = snapshot(place, (place / "out",))
        problems: list[str] = []
        codes: list[int] = []
        messages: list[str] = []
        outside: list[str] = []
        half: list[str] = []
        for moment, share in enumerate(random.uniform(size=kill.moments)):
            writes = moment % 2 == 1
            first = _FIRST_SHARE[kill.signal]
            after_s = share * write_s if writes else (first + (1 - first) * share) * whole_s
            code, said = _stop(kill, place, after_s, from_writing=writes)
            codes.append(code)
            messages.append(first_line(said, Path(name)) if "error: " in said else "")
            if code not in _CODES[kill.signal]:
                problems.append(f"moment {moment}: exit code {code}: {messages[-1]}")
            if "Traceback" in said:
                problems.append(f"moment {moment}: a traceback: {said.strip().splitlines()[-1]}")
            changed = changes(before, snapshot(place, (place / "out",)))
            # Killed outright, it cannot remove the folder beside the outputs in which it writes: the next run does.
            outside += [c for c in changed if kill.signal != signal.SIGKILL or not c.startswith(".out.")]
            half += _torn(kill, place)
        after = _left_alone(kill, place, sound, before)
    problems += [*outside, *half, *([] if after == "works" else [f"after it: {after}"])]
    return Row(
        kill.name,
        f"{kill.moments} moments of {whole_s:.1f} s, half of them in the {write_s:.1f} s of writing",
        ", ".join(str(code) for code in sorted(set(codes))),
        next((m for m in messages if m), ""),
        "; ".join(outside) or "nothing",
        "; ".join(half) or "nothing",
        after,
        time.perf_counter() - started,
        0.0,
        tuple(problems),
    )


def _durations(kill: Kill, sound: Path) -> tuple[float, float]:
    """Seconds of a whole run, and from its first change of the outputs to its end; its outputs are the reference."""
    _finish(_start(kill, sound))  # what is compiled now is kept
    (sound / "out").rename(sound / "first")
    started = time.perf_counter()
    process = _start(kill, sound)
    wrote = _first_change(process, sound)
    if (code := _finish(process)) != 0:
        raise RuntimeError(f"{kill.name}: without fault: exit code {code}")
    ended = time.perf_counter()
    return ended - started, ended - (wrote or ended)


def _start(kill: Kill, place: Path, said: int = subprocess.DEVNULL) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*COMMAND, *kill.arguments],
        cwd=place,
        env=environment({}),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=said,
        start_new_session=True,
    )


def _finish(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(LONGEST_S)
    finally:
        _kill_group(process.pid)


def _first_change(process: subprocess.Popen[bytes], place: Path) -> float | None:
    """When the outputs, or temporary ones beside them, first changed; None where the command ended before."""
    before = _writing(place)
    while process.poll() is None:
        if _writing(place) != before:
            return time.perf_counter()
        time.sleep(0.002)
    return None


def _writing(place: Path) -> list[tuple[str, int]]:
    found = [p for p in (place / "out", *place.glob(".out.*")) if p.exists()]
    found += [p for folder in found for p in folder.glob("*") if p.exists()]
    return sorted((str(p), p.stat().st_mtime_ns) for p in found if p.exists())


def _stop(kill: Kill, place: Path, after_s: float, from_writing: bool) -> tuple[int, str]:
    """Start the command, stop it so many seconds after its start or its first change; exit code and stderr."""
    with tempfile.TemporaryFile() as said:
        process = _start(kill, place, said.fileno())
        try:
            if from_writing:
                _first_change(process, place)
            try:
                process.wait(after_s)
            except subprocess.TimeoutExpired:
                if kill.signal == signal.SIGINT:
                    os.killpg(process.pid, kill.signal)
                else:
                    process.send_signal(kill.signal)
            code = process.wait(GONE_S)
            alive = _alive_after(process.pid)
        finally:
            _kill_group(process.pid)
            process.wait()
        said.seek(0)
        text = said.read().decode("utf-8", "replace")
    return (code, text) if not alive else (-99, f"error: {alive} processes live on after {GONE_S:.0f} s")


def _alive_after(group: int) -> int:
    """How many processes of a group still live after GONE_S."""
    deadline = time.perf_counter() + GONE_S
    while (alive := _alive(group)) and time.perf_counter() < deadline:
        time.sleep(0.05)
    return alive


def _alive(group: int) -> int:
    count = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of_group = path.read_text().rpartition(")")[2].split()[:3]
        except (OSError, ValueError):  # gone meanwhile
            continue
        count += int(of_group) == group and state not in "ZX"
    return count


def _kill_group(group: int) -> None:
    if _alive(group):
        os.killpg(group, signal.SIGKILL)


def _torn(kill: Kill, place: Path) -> list[str]:
    """What of the outputs is not whole: a file, or the set of files."""
    out = place / "out"
    if not out.exists():
        return []
    # A file that is being written has a name of its own, which no reader takes for a result.
    found = [problem for problem in broken_files(out) if not problem.endswith(": temporary")]
    missing = [file for file in kill.results if not (out / file).exists()]
    if kill.complete and missing:
        found.append(f"without {', '.join(missing)}")
    return found


def _left_alone(kill: Kill, place: Path, sound: Path, before: dict[str, str]) -> str:
    with tempfile.TemporaryFile() as said:
        code = _finish(_start(kill, place, said.fileno()))
        said.seek(0)
        text = said.read().decode("utf-8", "replace")
    if code:
        return f"exit code {code}: {first_line(text, place)}"
    wrong = broken_files(place / "out")
    wrong += [f"left beside it: {change}" for change in changes(before, snapshot(place, (place / "out",)))]
    there, expected = _names(place / "out"), _names(sound / "out")
    wrong += [f"{name}: {there[name]}, expected {count}" for name, count in expected.items() if there[name] < count]
    wrong += [
        f"{file}: other results"
        for file in kill.results
        if (place / "out" / file).read_bytes() != (sound / "out" / file).read_bytes()
    ]
    return "; ".join(wrong) or "works"


def _names(out: Path) -> Counter[str]:
    """How many files of each name; names made of hashes, which have the place of the inputs in them, are one name."""
    return Counter(_HASH.sub("*", p.relative_to(out).as_posix()) for p in out.rglob("*") if p.is_file())
