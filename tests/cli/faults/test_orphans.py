"""What a process that was killed outright left beside its outputs goes with the next; that of a living one stays."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from jaxgeo.errors import InputError
from jaxgeo.io.atomic import atomic_path, output_folder

_WRITES = """
import sys, time
from jaxgeo.io.atomic import output_folder
with output_folder(sys.argv[1]) as temporary:
    (temporary / "a.txt").write_text("half")
    print(flush=True)
    time.sleep(60)
"""


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process in the middle of writing the folder `out`."""
    process = subprocess.Popen([sys.executable, "-c", _WRITES, tmp_path / "out"], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def _write(folder: Path) -> None:
    with output_folder(folder) as temporary:
        (temporary / "a.txt").write_text("whole")


def test_only_what_no_process_holds_is_removed(tmp_path: Path, writer: subprocess.Popen[bytes]) -> None:
    kept = [tmp_path / name for name in (".out.mine.tmp", ".out.abcdefgh.tmp.d", ".output.abcdefgh.tmp")]
    for folder in kept:
        folder.mkdir()
    (held,) = tmp_path.glob(".out.????????.tmp")
    _write(tmp_path / "out")
    assert (held / "a.txt").read_text() == "half"
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    _write(tmp_path / "out")
    assert sorted(tmp_path.iterdir()) == sorted([*kept, tmp_path / "out"])
    assert (tmp_path / "out" / "a.txt").read_text() == "whole"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EFBIG, errno.EDQUOT])
def test_a_full_disk_is_named(tmp_path: Path, code: int) -> None:
    def write(context, name: str) -> None:
        with context(tmp_path / name):
            raise OSError(code, os.strerror(code))

    for context, name in ((output_folder, "out"), (atomic_path, "a.txt")):
        with pytest.raises(InputError, match=f"{name}: cannot be written: {os.strerror(code)}"):
            write(context, name)
    assert not list(tmp_path.iterdir())
