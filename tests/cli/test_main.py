"""The command line: exit codes, and one message instead of a traceback."""

import subprocess
import sys

import pytest

import jaxgeo.cli.run
from jaxgeo.cli.main import main
from jaxgeo.errors import ConfigError, UndeterminedError

CONFIG = """
name: site
crs: local
survey: {points: {A: {N: 1, E: 2, h: 3}}}
sightings: {kind: poses, file: sightings.csv}
trajectories: {icp: {file: icp.tum, format: tum, odometry: lidar}}
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text(CONFIG)
    return path


@pytest.fixture
def failing(monkeypatch, config):
    """`jaxgeo run` that raises what it is told to."""

    def run(error, *options):
        def fail(*_):
            raise error

        monkeypatch.setattr(jaxgeo.cli.run, "run_config", fail)
        return main([*options, "run", str(config)])

    return run


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (ConfigError("site.yaml: crs: missing"), 2, "error: site.yaml: crs: missing\n"),
        (UndeterminedError("two anchors"), 3, "error: two anchors\n"),
        (
            OSError(28, "No space left on device", "out/report.html"),
            2,
            "error: out/report.html: No space left on device\n",
        ),
        (KeyboardInterrupt(), 130, "error: interrupted\n"),
    ],
)
def test_an_error_is_one_message_and_its_exit_code(failing, capsys, error, code, message):
    assert failing(error) == code
    assert capsys.readouterr().err == message


def test_a_fault_of_ours_asks_for_a_report_and_hides_its_traceback(failing, capsys):
    assert failing(ZeroDivisionError("division by zero")) == 1
    err = capsys.readouterr().err
    assert "ZeroDivisionError: division by zero" in err
    assert "report it" in err
    assert "Traceback" not in err


def test_debug_shows_the_traceback(failing, capsys):
    assert failing(ConfigError("bad"), "--debug") == 2
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.endswith("error: bad\n")


@pytest.mark.parametrize(
    "arguments",
    [["fly"], ["run"], ["run", "x.yaml", "--fast"], ["simulate"], ["simulate", "--out", "x", "--seed", "-1"]],
)
def test_a_wrong_command_line_exits_2(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], []])
def test_help(arguments, capsys):
    assert main(arguments) == (0 if arguments else 2)
    assert "Usage: jaxgeo" in capsys.readouterr().out


def test_dump_config_prints_a_config_that_dumps_to_itself(config, capsys, tmp_path):
    assert main(["run", str(config), "--set", "coarse.scale=false", "--set", "seed=5", "--dump-config"]) == 0
    text = capsys.readouterr().out
    assert "scale: false" in text
    again = tmp_path / "again.yaml"
    again.write_text(text)
    assert main(["run", str(again), "--dump-config"]) == 0
    assert capsys.readouterr().out == text


def test_a_bad_config_leaves_no_output(config, capsys, tmp_path):
    assert main(["run", str(config), "--set", "coarse.scal=1", "--out", str(tmp_path / "out")]) == 2
    assert "unknown key 'scal'; did you mean 'scale'?" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_missing_config_is_named(capsys):
    assert main(["run", "nowhere.yaml"]) == 2
    assert "nowhere.yaml: cannot read the config: No such file" in capsys.readouterr().err


def test_out_that_is_a_file_is_refused_before_anything_is_computed(config, capsys):
    assert main(["run", str(config), "--out", str(config)]) == 2
    assert "expected a folder" in capsys.readouterr().err
    assert config.read_text() == CONFIG


def test_simulate_prints_the_config_that_runs_on_its_files(tmp_path, capsys):
    assert main(["simulate", "--out", str(tmp_path / "session"), "--seed", "7"]) == 0
    path = capsys.readouterr().out.strip()
    assert main(["run", path, "--dump-config"]) == 0
    text = capsys.readouterr().out
    assert "simulated: true" in text
    assert "seed: 7" in text


def test_the_process_returns_the_exit_code():
    done = subprocess.run([sys.executable, "-m", "jaxgeo.cli.main", "run", "x.yaml"], capture_output=True, check=False)
    assert done.returncode == 2
