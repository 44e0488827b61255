import csv
import json

import numpy as np
import pytest
import typer

from jaxgeo.cli.odometry import Source, body_lidar_of, run_odometry
from jaxgeo.cli.odometry_command import odometry
from jaxgeo.errors import InputError, ScanError
from jaxgeo.io import read_tum
from jaxgeo.odometry.lidar_odometry import OdometrySettings

STEP_M = 0.1


def room(rng):
    """Points on the six sides of a room with a step in it, from its middle."""
    points_m = rng.uniform(-1.0, 1.0, (3000, 3)) * [6.0, 4.0, 2.0]
    side = rng.integers(0, 3, 3000)
    half = np.array([6.0, 4.0, 2.0])[side]
    points_m[np.arange(3000), side] = np.where(rng.random(3000) < 0.5, half, -half)
    return points_m


@pytest.fixture
def recording(tmp_path):
    rng = np.random.default_rng(0)
    scans = [room(rng) - [STEP_M * k, 0.0, 0.0] for k in range(6)]
    path = tmp_path / "scans.npz"
    np.savez(
        path,
        xyz=np.round(np.concatenate(scans) / 0.001).astype(np.int16),
        scale=0.001,
        offsets=np.cumsum([0, *map(len, scans)]),
        times=10.0 + 0.5 * np.arange(6),
    )
    return path


def called(*arguments):
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(odometry)
    typer.main.get_command(app).main(list(map(str, arguments)), standalone_mode=False)


def test_the_files_say_what_was_done(recording, tmp_path, capsys):
    out = tmp_path / "out"
    called(recording, "--out", out)
    assert sorted(p.name for p in out.iterdir()) == ["odometry.csv", "odometry.json", "trajectory.tum"]
    trajectory = read_tum(out / "trajectory.tum")
    np.testing.assert_array_equal(trajectory.stamp_s, 10.0 + 0.5 * np.arange(6))
    np.testing.assert_allclose(trajectory.position_m[:, 0], STEP_M * np.arange(6), atol=0.02)
    rows = list(csv.DictReader((out / "odometry.csv").read_text().splitlines()[1:]))
    assert [float(row["stamp_s"]) for row in rows] == trajectory.stamp_s.tolist()
    assert all(0.4 < float(row["inlier_share"]) <= 1.0 and row["lost"] == "0" for row in rows)
    record = json.loads((out / "odometry.json").read_text())
    assert record["n_scans"] == 6
    assert record["settings"]["method"] == "gicp"
    assert set(record["versions"]) == {"jaxgeo", "small_gicp"}
    assert record["path_m"] == pytest.approx(0.5, abs=0.05)
    printed = capsys.readouterr().out
    assert "6 scans, 0.5 m; 0 lost" in printed
    assert "ms a scan" in printed
    assert "the sensor's period 500 ms" in printed


def test_quiet_prints_nothing(recording, tmp_path, capsys):
    called(recording, "--out", tmp_path / "out", "--quiet", "--rate", "10", "--start", "3")
    assert capsys.readouterr() == ("", "")
    np.testing.assert_allclose(read_tum(tmp_path / "out" / "trajectory.tum").stamp_s, 3.0 + 0.1 * np.arange(6))


def test_the_body_may_be_said(recording, tmp_path):
    called(recording, "--out", tmp_path / "out", "--quiet", "--T-body-lidar", "1,0,0,0,0,1,0")
    x = read_tum(tmp_path / "out" / "trajectory.tum").position_m[:, 0]
    np.testing.assert_allclose(x, -STEP_M * np.arange(6), atol=0.02)  # the sensor looks backwards


@pytest.mark.parametrize(
    ("text", "words"), [("1,2,3", "expected seven numbers"), ("0,0,0,0,0,0,2", "has length 2, expected 1")]
)
def test_a_pose_that_is_none(text, words):
    with pytest.raises(InputError, match=words):
        body_lidar_of(text)


def test_bad_input_leaves_no_files(recording, tmp_path):
    with pytest.raises(ScanError, match="0 points between 0 m and 1 m"):
        run_odometry(Source(recording), tmp_path / "out", OdometrySettings(max_range_m=1.0), quiet=True)
    with pytest.raises(InputError, match="method 'loam', expected one of gicp, kiss"):
        called(recording, "--out", tmp_path / "out", "--method", "loam")
    with pytest.raises(ScanError, match="no such file or folder"):
        called(tmp_path / "none", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
