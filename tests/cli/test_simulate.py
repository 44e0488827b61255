"""`jaxgeo simulate`: its options, and files that the main job reads."""

import json

import numpy as np
import pytest

from jaxgeo.cli.ingest import ingest
from jaxgeo.cli.main import main
from jaxgeo.config import load_config
from jaxgeo.simulate.regimes import REGIMES


def test_both_sessions_with_faults_are_read_as_told(tmp_path, capsys):
    faults = ["--swap-visits", "2,5", "--swap-locations", "B,E", "--shift", "C=5,0,-1", "--time-offset", "0.2"]
    assert (
        main(["simulate", "--out", str(tmp_path), "--seed", "3", "--session", "both", *faults, "--label", "3=F"]) == 0
    )
    printed = capsys.readouterr().out.split()
    assert printed == [str(tmp_path / name / "config.yaml") for name in ("uav", "ugv")]
    for path, n_poses in zip(printed, (1800, 1829), strict=True):
        config = load_config(path)
        data = ingest(config)
        assert config.simulated
        assert [visit.location for visit in data.visits] == list("AEFDBFA")
        assert len(data.trajectories["icp"]) == len(data.references["dense"]) == n_poses
        surveyed = dict(zip(data.survey.name, data.survey.enh_m.tolist(), strict=True))
        np.testing.assert_allclose(surveyed["B"], [79309.431, 76804.525, 340.234])
        np.testing.assert_allclose(surveyed["C"], [79368.262, 76821.262, 337.276])
        truth = json.loads((path_of(path) / "truth.json").read_text())
        assert truth["faults"]["time_offset_s"] == 0.2
        assert truth["order_told"] == list("AEFDBFA")


def path_of(config):
    return load_config(config).survey.file.parent


@pytest.mark.parametrize("drift", REGIMES)
def test_every_drift_is_read(drift, tmp_path, capsys):
    assert main(["simulate", "--out", str(tmp_path / "s"), "--session", "ugv", "--drift", drift]) == 0
    config = load_config(capsys.readouterr().out.strip())
    assert config.name == "simulated_ugv"
    data = ingest(config)
    assert list(data.trajectories) == ["icp", "dense"]
    assert not data.warnings
    assert len(data.visits) == 7


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--session", "car"], "--session 'car': expected uav, ugv or both."),
        (["--drift", "none"], "drift 'none': expected one of paper,"),
        (["--swap-visits", "2"], "--swap-visits '2': expected two visits, counted from 1: 2,5."),
        (["--swap-visits", "B,C"], "--swap-visits 'B,C': expected two visits"),
        (["--swap-visits", "2,8"], "fault at visit 8: the session has visits 1 to 7"),
        (["--swap-locations", "B"], "--swap-locations 'B': expected two locations"),
        (["--swap-locations", "B,X"], "fault at location 'X'"),
        (["--shift", "C=5,0"], "--shift 'C=5,0': expected a location and metres"),
        (["--shift", "C"], "--shift 'C': expected a location and metres"),
        (["--shift", "C=nan,0,0"], "shifted location 'C': (nan, 0.0, 0.0); expected three finite numbers"),
        (["--label", "D=3"], "--label 'D=3': expected a visit"),
        (["--time-offset", "nan"], "time_offset_s: nan"),
    ],
)
def test_bad_options_are_one_message_and_exit_2(options, message, tmp_path, capsys):
    assert main(["simulate", "--out", str(tmp_path / "s"), *options]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"error: {message}")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_output_folder_that_is_a_file_is_refused(tmp_path, capsys):
    (tmp_path / "s").write_text("kept")
    assert main(["simulate", "--out", str(tmp_path / "s"), "--session", "both"]) == 2
    assert "is a file, expected a folder" in capsys.readouterr().err
    assert (tmp_path / "s").read_text() == "kept"
