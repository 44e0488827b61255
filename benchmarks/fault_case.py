"""One fault put to one command: what is done, how the command runs, and what is checked of it."""

import dataclasses
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.fault_whole import broken_files, changes, snapshot

ROOT = Path(__file__).resolve().parents[1]
COMMAND = (sys.executable, "-m", "jaxgeo.cli.main")
ADDRESS_SPACE_BYTES = 6 << 30
MOST_RSS_MB = 1500.0
LIMIT_S = 60.0
RUN_LIMIT_S = 300.0  # of what is to end well: it may have to compile
KEPT = ("detections.jsonl",)  # the record from which `jaxgeo detect` goes on
Change = Callable[[Path], None]


def nothing(_: Path) -> None:
    """No change."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A fault that a command refuses.

    Attributes:
        name: short, for the command line and the table.
        done: what was done, in words.
        inputs: makes the sound inputs in an empty folder.
        spoil, mend: puts the fault into that folder; takes it out again, None where it is no fault of the inputs.
        arguments: of `jaxgeo`, given in that folder, which the outputs `out` are a folder of.
        says: each must stand in the message: the place, the value.
        codes: exit codes that are right; 0 where the fault must not matter, or costs one item and a warning.
        wrap: makes the whole command line of the faulty run of `jaxgeo`'s; the outputs are looked at afterwards.
        variables: environment variables of the faulty run; None takes one away.
        results: files of the outputs that must be the same after the fault as without any.
        limit_bytes, limit_s: address space and seconds of the faulty run; JAX needs more than a reader.
    """

    name: str
    done: str
    inputs: Change
    arguments: tuple[str, ...]
    spoil: Change = nothing
    mend: Change | None = None
    says: tuple[str, ...] = ()
    codes: tuple[int, ...] = (2,)
    out: str = "out"
    wrap: Callable[[Path, Sequence[str]], Sequence[str]] | None = None
    variables: Mapping[str, str | None] = dataclasses.field(default_factory=dict)
    results: tuple[str, ...] = ()
    limit_bytes: int = ADDRESS_SPACE_BYTES
    limit_s: float = LIMIT_S


@dataclasses.dataclass(frozen=True)
class Ran:
    """How a command ended: exit code, what it said on stderr, wall seconds, and the most memory it held."""

    code: int
    stderr: str
    seconds: float
    rss_mb: float


@dataclasses.dataclass(frozen=True)
class Row:
    """A row of the table; `problems` is empty where everything that is checked holds.

    Attributes:
        code: exit code or codes, as text.
        outside: what changed outside of the outputs.
        half: what of the outputs is not whole.
        after: what the same command gave with the fault gone: works, or what is wrong; '-' where it was not tried.
    """

    name: str
    done: str
    code: str
    message: str
    outside: str
    half: str
    after: str
    seconds: float
    rss_mb: float
    problems: tuple[str, ...] = ()


def attempt(case: Case, repeat: bool = True) -> Row:
    """Run a command with its fault, check what it left, and run it again without the fault."""
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        place = Path(name) / "work"
        place.mkdir()
        case.inputs(place)
        case.spoil(place)
        out = place / case.out
        before = snapshot(Path(name), (out,))
        line = [*COMMAND, *case.arguments]
        ran = run(
            line if case.wrap is None else case.wrap(place, line), place, case.variables, case.limit_bytes, case.limit_s
        )
        outside = changes(before, snapshot(Path(name), (out,)))
        half = broken_files(out) if out.is_dir() and not out.is_symlink() else []
        if 0 not in case.codes and out.is_dir() and not out.is_symlink():
            half += [
                f"{p.name}: written by a run that failed" for p in out.iterdir() if p.is_file() and p.name not in KEPT
            ]
        problems = [*_wrong_ends(case, ran), *outside, *half]
        after = "-"
        if repeat and (case.mend is not None or case.wrap is not None or case.variables):
            after = _again(case, place, out)
            problems += [] if after == "works" else [f"after it: {after}"]
        return Row(
            case.name,
            case.done,
            str(ran.code),
            first_line(ran.stderr, Path(name)),
            "; ".join(outside) or "nothing",
            "; ".join(half) or "nothing",
            after,
            ran.seconds,
            ran.rss_mb,
            tuple(problems),
        )


def _wrong_ends(case: Case, ran: Ran) -> list[str]:
    """What is wrong with how a refused command ended."""
    wrong = []
    if ran.code not in case.codes:
        wrong.append(f"exit code {ran.code}, expected {' or '.join(map(str, case.codes))}")
    if "Traceback" in ran.stderr:
        wrong.append("a traceback")
    if ran.code != 0:
        errors = [line for line in ran.stderr.splitlines() if line.startswith("error: ")]
        if len(errors) != 1:
            wrong.append(f"{len(errors)} errors on stderr, expected one")
    wrong += [f"the message does not name {what!r}" for what in case.says if what not in ran.stderr]
    if ran.rss_mb > MOST_RSS_MB:
        wrong.append(f"{ran.rss_mb:.0f} MB of memory, expected at most {MOST_RSS_MB:.0f}")
    if ran.seconds >= case.limit_s:
        wrong.append(f"stopped after {case.limit_s:.0f} s")
    return wrong


def _again(case: Case, place: Path, out: Path) -> str:
    """The same command once the fault is gone, against the results of sound inputs in an empty folder."""
    (case.mend or nothing)(place)
    ran = run([*COMMAND, *case.arguments], place)
    if ran.code:
        return f"exit code {ran.code}: {first_line(ran.stderr, place)}"
    if broken := broken_files(out):
        return "; ".join(broken)
    if not case.results:
        return "works"
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        sound = Path(name) / "work"
        sound.mkdir()
        case.inputs(sound)
        reference = _reference(case, sound)
    wrong = [file for file in case.results if reference.get(file) != (out / file).read_bytes()]
    return f"other results: {', '.join(wrong)}" if wrong else "works"


_REFERENCES: dict[tuple[object, ...], dict[str, bytes]] = {}


def _reference(case: Case, place: Path) -> dict[str, bytes]:
    """Results without fault, computed once for each command."""
    key = (case.inputs, case.arguments, case.results)
    if key not in _REFERENCES:
        ran = run([*COMMAND, *case.arguments], place)
        if ran.code:
            raise RuntimeError(f"{case.name}: without fault: exit code {ran.code}: {ran.stderr}")
        _REFERENCES[key] = {file: (place / case.out / file).read_bytes() for file in case.results}
    return _REFERENCES[key]


def run(
    line: Sequence[str],
    place: Path,
    variables: Mapping[str, str | None] | None = None,
    limit_bytes: int | None = None,
    limit_s: float = RUN_LIMIT_S,
) -> Ran:
    """Run a command line in a folder and wait for its end; what is left of it after `limit_s` is killed."""
    started = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            line,
            cwd=place,
            env=environment(variables or {}),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=said,
            preexec_fn=None if limit_bytes is None else _limited(limit_bytes),
            start_new_session=True,
        )
        usage = None
        while usage is None:
            ended, status, spent = os.wait4(process.pid, os.WNOHANG)
            if ended:
                process.returncode = os.waitstatus_to_exitcode(status)
                usage = spent
            elif time.perf_counter() - started > limit_s:
                os.killpg(process.pid, 9)
            else:
                time.sleep(0.02)
        said.seek(0)
        text = said.read().decode("utf-8", "replace")
    return Ran(process.returncode, text, time.perf_counter() - started, usage.ru_maxrss / 1024)


def _limited(limit_bytes: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, limit_bytes))


def environment(variables: Mapping[str, str | None]) -> dict[str, str]:
    """The environment of a command: this one's, two threads, and the fault's own variables."""
    found = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "2", "PYTHONDONTWRITEBYTECODE": "1"}
    for key, value in variables.items():
        found.pop(key, None)
        if value is not None:
            found[key] = value
    return found


def first_line(stderr: str, place: Path) -> str:
    """The message without the temporary folder's name; warnings and bars before it are left out."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    told = [line for mark in ("error: ", "warning: ") for line in lines if line.startswith(mark)]
    found = next(iter(told or lines[-1:]), "")
    return found.removeprefix("error: ").replace(f"{place}/work/", "").replace(f"{place}/", "")


def copied(source: Path) -> Change:
    """Puts a copy of a folder's files into the case's folder."""

    def copy(place: Path) -> None:
        shutil.copytree(source, place, dirs_exist_ok=True, symlinks=True)

    return copy
