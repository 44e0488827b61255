"""One target under atheris: `python -m benchmarks.fuzz.worker NAME SECONDS FOLDER`, which `benchmarks.fuzz` starts.

A file that breaks the contract is noted and the run goes on, one note for each place in the code that it comes from;
what ends the process (no memory, a hang, a crash of a library) libFuzzer writes down itself.
"""

import hashlib
import json
import os
import random
import sys
import tempfile
import time
from pathlib import Path

import atheris

# Of the libraries only those in Python that parse: the others would slow everything down.
with atheris.instrument_imports(include=["jaxgeo", "yaml", "laspy", "rosbags"]):
    from benchmarks.fuzz.target import BrokenContractError, Target, attempt
    from benchmarks.fuzz.targets import TARGETS

_TIMEOUT_S, _MOST_MB = 30, 4096
_LONGEST_FILE = 1 << 16


class Run:
    """What one run tried and found; it says so in `result.json`, every second."""

    def __init__(self, target: Target, folder: Path) -> None:
        self._target = target
        self._folder = folder
        self._begin_s = self._told_s = time.monotonic()
        self._scratch = tempfile.TemporaryDirectory()
        self._executions = self._refused = 0
        self._why: dict[str, str] = {}

    def one(self, data: bytes) -> None:
        """Try one file."""
        self._executions += 1
        try:
            self._refused += attempt(self._target, data, Path(self._scratch.name)) is not None
        except BrokenContractError as broken:
            place = _place(broken)
            if place not in self._why:
                self._why[place] = f"{place}: {broken}"[:300]
                name = f"crash-{hashlib.sha256(data).hexdigest()[:16]}"
                (self._folder / "crashes" / name).write_bytes(data)
            for left in Path(self._scratch.name).iterdir():
                left.unlink()
        if time.monotonic() - self._told_s > 1.0:
            self._told_s = time.monotonic()
            self.tell()

    def tell(self) -> None:
        """Write down what there is so far."""
        told = {
            "executions": self._executions,
            "refused": self._refused,
            "seconds": time.monotonic() - self._begin_s,
            "why": list(self._why.values()),
        }
        (self._folder / "result.json").write_text(json.dumps(told), encoding="utf-8")

    def damaged(self, data: bytes, most: int, seed: int) -> bytes:
        """libFuzzer's step, or one of ours."""
        rng = random.Random(seed)
        step = rng.randrange(4)
        if step < 2:
            return atheris.Mutate(data, most)
        return self._target.mutated(rng, data if step == 2 else None)[:most]


def _place(broken: BrokenContractError) -> str:
    """File and line of jaxgeo that the failure went through last, or the kind of breach."""
    place = str(broken).partition(": ")[2][:60]
    trace = broken.__cause__.__traceback__ if broken.__cause__ is not None else None
    while trace is not None:
        file = Path(trace.tb_frame.f_code.co_filename)
        if "jaxgeo" in file.parts and "site-packages" not in file.parts:
            place = f"{file.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place


def main(name: str, seconds: int, folder: Path) -> None:
    """Fuzz until the time is over; does not return."""
    target = TARGETS[name]
    for part in ("corpus", "crashes"):
        (folder / part).mkdir()
    for i, example in enumerate((*target.examples(), *target.once_crashed.values())):
        (folder / "corpus" / f"{i:03d}").write_bytes(example)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    run = Run(target, folder)
    run.tell()
    options = [
        f"-max_total_time={seconds}",
        f"-timeout={_TIMEOUT_S}",
        f"-rss_limit_mb={_MOST_MB}",
        f"-max_len={_LONGEST_FILE}",
        f"-artifact_prefix={folder / 'crashes'}/",
        "-verbosity=0",
        "-seed=1",
    ]
    atheris.Setup([sys.argv[0], *options, str(folder / "corpus")], run.one, custom_mutator=run.damaged)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
