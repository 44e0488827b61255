"""What `jaxgeo run` does around the estimate: the folder it writes to, what it prints, and nothing on failure."""

import sys
import types

import pytest

import jaxgeo.export
import jaxgeo.precision
from jaxgeo.cli.main import main
from jaxgeo.errors import UndeterminedError


@pytest.fixture
def session(monkeypatch, tmp_path):
    """A simulated session's config, and an estimator in place of the real one; `calls` is what reached the writer."""
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--out", "made"]) == 0
    calls = []

    def run_session(config, progress, out, check):
        assert check
        progress.phase("read")
        if config.seed == 13:
            raise UndeterminedError("the anchors lie on a line")
        trajectories = {"icp": types.SimpleNamespace(warnings=("stamps are late",), corrections=None)}
        return types.SimpleNamespace(simulated=config.simulated, trajectories=trajectories)

    monkeypatch.setitem(sys.modules, "jaxgeo.cli.session", types.SimpleNamespace(run_session=run_session))
    monkeypatch.setattr(jaxgeo.export, "write_session", lambda result, out: calls.append((result, out)))
    monkeypatch.setattr(jaxgeo.precision, "enable_compilation_cache", lambda: None)
    return calls


def test_writes_to_a_folder_of_the_sessions_name_and_says_where(session, capsys):
    assert main(["run", "made/config.yaml"]) == 0
    [(result, out)] = session
    assert result.simulated
    assert out.as_posix() == "out/simulated_uav"
    printed = capsys.readouterr()
    assert "simulated_uav (simulated data): out/simulated_uav/report.html" in printed.out
    assert "warning: icp: stamps are late" in printed.err
    assert "read " in printed.err
    assert "write out/simulated_uav" in printed.err


def test_quiet_prints_nothing(session, capsys):
    capsys.readouterr()
    assert main(["run", "made/config.yaml", "--out", "here", "--quiet"]) == 0
    assert session[0][1].as_posix() == "here"
    assert capsys.readouterr() == ("", "")


def test_a_failed_estimate_writes_nothing_and_exits_3(session, capsys):
    assert main(["run", "made/config.yaml", "--set", "seed=13"]) == 3
    assert not session
    assert capsys.readouterr().err.endswith("error: the anchors lie on a line\n")


def test_demo_runs_on_files_that_it_simulated(session, tmp_path):
    assert main(["demo", "--seed", "2", "--quiet"]) == 0
    assert session[0][1].as_posix() == "out/demo"
    assert (tmp_path / "out" / "demo" / "session" / "config.yaml").is_file()
