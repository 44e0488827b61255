"""Outputs are written whole or not at all: a bad place, a full disk, signals."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.bad_input.runs import run, snapshot

import jaxgeo.cli.run
import jaxgeo.io.atomic
from jaxgeo.cli.main import TERMINATED, main


@pytest.mark.parametrize("out", ["survey.csv", "survey.csv/out", "survey.csv/a/b"])
def test_an_output_folder_that_cannot_be_is_refused_before_the_work(session, capsys, monkeypatch, out):
    monkeypatch.setitem(sys.modules, "jaxgeo.cli.session", None)  # to import it would fail
    before = snapshot(session)
    assert run(session, out=out) == 2
    message = capsys.readouterr().err
    assert re.search(r"^error: .*survey\.csv.*is a file, expected a folder .*Name another", message)
    assert snapshot(session) == before


def test_a_folder_in_the_place_of_an_output_leaves_the_older_result_whole(session, metrics, capsys):
    metrics()
    (session / "out" / "report.html").unlink()
    (session / "out" / "report.html").mkdir()
    before = snapshot(session)
    assert run(session) == 2
    assert re.search(r"error: .*report\.html: is a folder", capsys.readouterr().err)
    assert snapshot(session) == before


def test_a_full_disk_leaves_the_older_result_whole(session, metrics, capsys, monkeypatch):
    metrics()
    before = snapshot(session)
    real = Path.write_text

    def write_text(path, *args, **kwargs):
        if path.name == "report.html":
            raise OSError(28, "No space left on device", str(path))
        return real(path, *args, **kwargs)

    monkeypatch.setattr(Path, "write_text", write_text)
    assert run(session) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert snapshot(session) == before


@pytest.fixture
def interruptible() -> Iterator[None]:
    """SIGINT as Python takes it; a shell's background job would ignore it."""
    kept = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, kept)


class Removed:
    """Gets a signal while it is removed: Python drops what is raised then."""

    def __init__(self, signal_):
        self._signal = signal_

    def __del__(self):
        signal.raise_signal(self._signal)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize(("signal_", "code"), [(signal.SIGTERM, TERMINATED), (signal.SIGINT, 130)])
def test_a_signal_that_python_drops_comes_again(monkeypatch, tmp_path, capsys, signal_, code):
    def run_config(*_):
        Removed(signal_)
        time.sleep(30)

    monkeypatch.setattr(jaxgeo.cli.run, "run_config", run_config)
    started = time.monotonic()
    assert main(["run", str(tmp_path / "any.yaml")]) == code
    assert time.monotonic() - started < 10
    assert capsys.readouterr().err in ("error: terminated\n", "error: interrupted\n")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize(("signal_", "code"), [(signal.SIGTERM, TERMINATED), (signal.SIGINT, 130)])
def test_a_signal_while_files_are_written_leaves_nothing(session, capsys, monkeypatch, signal_, code):
    monkeypatch.setattr(jaxgeo.io.atomic, "_umask", lambda: signal.raise_signal(signal_) or 0)
    before = snapshot(session)
    assert run(session) == code
    assert capsys.readouterr().err in ("error: terminated\n", "error: interrupted\n")
    assert snapshot(session) == before


def test_a_signal_while_files_are_put_in_place_waits_until_all_are(session, metrics, monkeypatch):
    metrics()
    (session / "out" / "metrics.json").write_text("old")
    (session / "out" / "report.html").write_text("old")
    real = os.replace

    def replace_and_signal(old, new):
        signal.raise_signal(signal.SIGTERM)
        real(old, new)

    monkeypatch.setattr(os, "replace", replace_and_signal)
    assert run(session) == TERMINATED
    written = {name: data for name, data in snapshot(session).items() if name.startswith(("out", ".out"))}
    assert b"old" not in written.values()
    assert not [name for name in written if name.startswith(".out")]


def test_sigterm_ends_a_running_process_cleanly(session):
    before = snapshot(session)
    command = [
        sys.executable,
        "-m",
        "jaxgeo.cli.main",
        "run",
        str(session / "poses.yaml"),
        "--out",
        str(session / "out"),
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        first = process.stderr.readline()  # the first phase is done
        process.send_signal(signal.SIGTERM)
        rest = process.stderr.read()
        code = process.wait(timeout=60)
    assert first.startswith("read small")
    assert (code, rest.splitlines()[-1]) == (TERMINATED, "error: terminated")
    assert snapshot(session) == before
