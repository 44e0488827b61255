"""Where the outputs go, and what surrounds the command: a full disk, a folder that cannot be written to, odd names.

A full disk is a small file system of its own (tmpfs), mounted where only the command sees it (`unshare --mount`, with a
user namespace where this is not root); where that is refused, the largest size of a file is limited instead
(RLIMIT_FSIZE), which fails in the same places with "File too large".
"""

import functools
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from benchmarks import fault_inputs as inputs
from benchmarks.fault_case import RUN_LIMIT_S, Case, Change, nothing
from benchmarks.fault_files import RUN_RESULTS

RUN = ("run", "poses.yaml", "--out", "out", "--quiet")
LIMIT_BYTES = 12 << 30  # JAX reserves addresses that it never uses
_FULL_KB = (0, 16, 64, 200)


@functools.cache
def mounts() -> bool:
    """Whether a file system can be mounted here, for one command alone."""
    if shutil.which("unshare") is None:
        return False
    return subprocess.run([*_unshare(), "mount -t tmpfs tmpfs /mnt"], capture_output=True, check=False).returncode == 0


def _unshare() -> list[str]:
    return ["unshare", *([] if os.geteuid() == 0 else ["--user", "--map-root-user"]), "--mount", "sh", "-c"]


def _in_small_place(options: str, fill: str = "") -> Callable[[Path, Sequence[str]], Sequence[str]]:
    """Runs a command whose folder `mounted` is a file system of its own; what it left there is copied out of it.

    Args:
        options: of the mount.
        fill: a command run in it before.
    """

    def wrap(place: Path, line: Sequence[str]) -> Sequence[str]:
        script = (
            f"mount -t tmpfs -o size=64m tmpfs mounted && mount -o remount,{options} mounted && {fill or 'true'}"
            f" || exit 99; {shlex.join(line)}; code=$?; cp -a mounted/out out-there 2> /dev/null; exit $code"
        )
        return [*_unshare(), script]

    return wrap


def _size_limited(kb: int) -> Callable[[Path, Sequence[str]], Sequence[str]]:
    return lambda place, line: ["sh", "-c", f"ulimit -f {max(kb, 1)}; exec {shlex.join(line)}"]


def _with_mounted(place: Path) -> None:
    inputs.session()(place)
    (place / "mounted").mkdir()


def place_cases() -> Iterator[Case]:
    """Full disks, outputs that cannot be written, and environments that are not what they should be."""
    yield from _disks()
    for name, (done, spoil, mend, out, says) in _PLACES.items():
        arguments = ("run", "poses.yaml", "--out", out, "--quiet")
        yield Case(
            f"output: {name}",
            done,
            inputs.session(),
            arguments,
            spoil,
            mend,
            says=says,
            out=out,
            results=RUN_RESULTS,
            limit_bytes=LIMIT_BYTES,
            limit_s=RUN_LIMIT_S,
        )
    for name, (done, variables) in _ENVIRONMENTS.items():
        yield Case(
            f"environment: {name}",
            done,
            inputs.session(),
            RUN,
            codes=(0,),
            variables=variables,
            results=RUN_RESULTS,
            limit_bytes=LIMIT_BYTES,
            limit_s=RUN_LIMIT_S,
        )
    for name, folder in _NAMES.items():
        yield Case(
            f"name: {name}",
            f"all inputs and outputs in a folder {folder!r}",
            _inside(folder),
            ("run", f"./{folder}/poses.yaml", "--out", f"./{folder}/out", "--quiet"),
            codes=(0,),
            out=f"{folder}/out",
            limit_bytes=LIMIT_BYTES,
            limit_s=RUN_LIMIT_S,
        )


def _disks() -> Iterator[Case]:
    arguments = ("run", "poses.yaml", "--out", "mounted/out", "--quiet")
    for kb in _FULL_KB:
        if mounts():
            done, wrap, says = f"a file system with {kb} kB free", _in_small_place(f"size={max(kb, 4)}k"), "mounted"
            if kb == 0:
                wrap = _in_small_place("size=64k", "head -c 65536 /dev/zero > mounted/full 2> /dev/null; true")
        else:
            done, wrap, says = f"files limited to {kb} kB (RLIMIT_FSIZE)", _size_limited(kb), ""
        yield Case(
            f"full disk: {kb} kB",
            done,
            _with_mounted,
            arguments,
            wrap=wrap,
            says=(says,),
            out="mounted/out",
            results=RUN_RESULTS,
            limit_bytes=LIMIT_BYTES,
            limit_s=RUN_LIMIT_S,
        )
    if mounts():
        yield Case(
            "output: read-only",
            "a file system mounted read-only",
            _with_mounted,
            arguments,
            wrap=_in_small_place("ro"),
            says=("mounted", "cannot write into"),
            out="mounted/out",
            results=RUN_RESULTS,
            limit_bytes=LIMIT_BYTES,
            limit_s=RUN_LIMIT_S,
        )


def _inside(folder: str) -> Change:
    def make(place: Path) -> None:
        (place / folder).mkdir(parents=True)
        inputs.session()(place / folder)

    return make


def _file(place: Path) -> None:
    (place / "taken").write_text("kept\n")


def _no_file(place: Path) -> None:
    (place / "taken").unlink()


def _link_to_file(place: Path) -> None:
    (place / "taken").symlink_to("survey.csv")


def _loop(place: Path) -> None:
    (place / "taken").symlink_to("taken")


def _dangling(place: Path) -> None:
    (place / "taken").symlink_to("nowhere/deeper")


def _folder_in_place(place: Path) -> None:
    (place / "taken/trajectory.tum").mkdir(parents=True)


def _no_folder_in_place(place: Path) -> None:
    (place / "taken/trajectory.tum").rmdir()


_PLACES: dict[str, tuple[str, Change, Change | None, str, tuple[str, ...]]] = {
    "a file": ("the folder of outputs is a file", _file, _no_file, "taken", ("taken", "is a file")),
    "below a file": ("a folder above it is a file", _file, _no_file, "taken/deep/out", ("taken", "is a file")),
    "an input": ("it is one of the inputs", nothing, None, "survey.csv", ("survey.csv", "is a file")),
    "a link to a file": ("it is a link to an input", _link_to_file, _no_file, "taken", ("taken", "is a file")),
    "a link to itself": ("it is a link to itself", _loop, _no_file, "taken", ("taken",)),
    "folder for file": (
        "trajectory.tum in it is a folder",
        _folder_in_place,
        _no_folder_in_place,
        "taken",
        ("trajectory.tum", "is a folder"),
    ),
    "/dev/null": ("it is /dev/null", nothing, None, "/dev/null", ("/dev/null",)),
    "/proc": ("it is in /proc", nothing, None, "/proc/out", ("/proc",)),
}
_ENVIRONMENTS: dict[str, tuple[str, dict[str, str | None]]] = {
    "no HOME": ("HOME is not set", {"HOME": None, "XDG_CACHE_HOME": None, "JAXGEO_CACHE": None}),
    "no cache": (
        "HOME and the cache of compiled programs cannot be written to",
        {"HOME": "/proc", "XDG_CACHE_HOME": "/proc", "JAXGEO_CACHE": None},
    ),
    "locale C": (
        "LC_ALL=C, Python told not to use UTF-8",
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ),
    "Latin-1": ("stdout and stderr in Latin-1", {"PYTHONIOENCODING": "latin-1", "LC_ALL": "C"}),
    "no TERM": ("TERM=dumb, 20 columns", {"TERM": "dumb", "COLUMNS": "20"}),
}
_NAMES = {
    "spaces": "my walk",
    "unicode": "Vermessung Ü 測量",
    "line feed": "two\nlines",
    "dash": "-out",
    "quotes": 'it\'s "it" $HOME',
}
