"""`jaxgeo simulate-sensors`: its options, what it prints, and a config that the main job reads."""

import json
import warnings
from pathlib import Path

import pytest
import typer

from jaxgeo.cli import simulate_sensors_command
from jaxgeo.cli.simulate_sensors import SensorOptions, simulate_sensors
from jaxgeo.config import load_config
from jaxgeo.errors import InputError
from jaxgeo.io.scans.source import open_scans

SMALL = SensorOptions(seed=0, duration_s=0.6, lidar_rate_hz=10.0, rings=4, rgbd=False, workers=1)


def test_the_command_writes_both_sessions_and_prints_their_configs(tmp_path, capsys):
    app = typer.Typer()
    app.command()(simulate_sensors_command.simulate_sensors)
    words = "--seed 0 --session both --duration 0.6 --lidar-rate 10 --rings 4 --no-rgbd --workers 1"
    app(["--out", str(tmp_path / "out"), *words.split()], standalone_mode=False)
    told = capsys.readouterr()
    printed = told.out.split()
    assert printed == [str(tmp_path / "out" / name / "config.yaml") for name in ("uav", "ugv")]
    assert "render uav" in told.err
    for path in printed:
        config = load_config(path)
        assert config.simulated
        assert config.scans is not None
        assert config.rgbd is None
        scans = list(open_scans(config.scans.path))
        assert len(scans) == 6
        assert 50 < len(scans[0]) <= 4 * 600
        truth = json.loads((Path(path).parent / "truth.json").read_text())
        assert truth["lidar"]["rings"] == 4
        assert truth["rgbd"] is None


def test_quiet_says_nothing(tmp_path, capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert simulate_sensors(tmp_path / "out", SMALL, quiet=True) == [tmp_path / "out" / "config.yaml"]
    told = capsys.readouterr()
    assert told.out == told.err == ""


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"session": "car"}, r"--session 'car': expected uav, ugv or both"),
        ({"format": "ros1"}, r"--format 'ros1': expected files or ros2"),
        ({"duration_s": 0.01}, r"duration 0\.01 s: expected"),
        ({"lidar_rate_hz": 0.0}, r"LiDAR: .* 0 Hz; expected"),
        ({"rgbd": True, "rgbd_rate_hz": -1.0}, r"RGB-D camera: -1 "),
    ],
)
def test_wrong_options_are_refused_before_anything_is_written(wrong, message, tmp_path):
    options = SensorOptions(**{**vars(SMALL), **wrong})
    with pytest.raises(InputError, match=message):
        simulate_sensors(tmp_path / "out", options)
    assert list(tmp_path.iterdir()) == []
