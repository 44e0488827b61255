"""The progress display where there is no terminal, and its silence."""

import re

import pytest

from jaxgeo.cli.progress import Progress


def test_plain_lines_in_order_with_times(capsys):
    with Progress() as progress:
        progress.phase("read")
        progress.phase("correct", "icp [1]")
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"read +\d+\.\d\d s\ncorrect icp \[1\] +\d+\.\d\d s\n", err)


def test_quiet_says_nothing(capsys):
    with Progress(quiet=True) as progress:
        progress.phase("read")
    assert capsys.readouterr() == ("", "")


def test_a_phase_that_failed_is_not_reported_as_done(capsys):
    def fail():
        with Progress() as progress:
            progress.phase("read")
            raise ValueError("bad")

    with pytest.raises(ValueError, match="bad"):
        fail()
    assert capsys.readouterr().err == ""
