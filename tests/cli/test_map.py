"""`jaxgeo map`: files in, files out, and what it refuses."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest
import typer
from mapping.walled_loop import drifting, rmse_m, scans_of, walk, world
from typer.testing import CliRunner

from jaxgeo.cli.map import FrameSource, MapOptions, make_map
from jaxgeo.cli.map_command import map_
from jaxgeo.cli.odometry import Source
from jaxgeo.errors import InputError, ScanError, TrajectoryError
from jaxgeo.io.clouds import open_cloud
from jaxgeo.io.g2o_graph import read_g2o_graph
from jaxgeo.io.scans.write import write_packed_scans
from jaxgeo.io.tum import read_tum, write_tum
from jaxgeo.mapping.map_settings import MapSettings


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path, np.ndarray]:
    """Trajectory, scans, true positions."""
    folder = tmp_path_factory.mktemp("walk")
    rng = np.random.default_rng(3)
    truth = walk()
    write_packed_scans(folder / "scans.npz", scans_of(truth, world(rng), rng))
    write_tum(folder / "odometry.tum", drifting(truth, 0.15, 0.03))
    return folder / "odometry.tum", folder / "scans.npz", truth[:, :3, 3]


@pytest.fixture(scope="module")
def made(files) -> tuple[Path, str]:
    """The folder written, and what was printed."""
    trajectory, scans, _ = files
    out = trajectory.parent / "out"
    printed = io.StringIO()
    settings = MapSettings(threads=1, voxel_m=0.15, keyframe_m=0.8)
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        make_map(trajectory, out, MapOptions(scans=Source(scans)), settings)
    return out, printed.getvalue()


def test_every_file_is_there_and_no_other(made):
    out, _ = made
    names = {"trajectory.tum", "graph.g2o", "closures.csv", "cloud.ply", "map.json", "map.png"}
    assert {path.name for path in out.iterdir()} == names
    assert not list(out.parent.glob(".out*"))


def test_the_written_trajectory_is_the_closed_one(files, made):
    given, truth_m = read_tum(files[0]), files[2]
    closed = read_tum(made[0] / "trajectory.tum")
    assert np.array_equal(closed.stamp_s, given.stamp_s)
    assert rmse_m(closed.position_m, truth_m) < 0.3 * rmse_m(given.position_m, truth_m)


def test_the_table_lists_every_closure_and_the_graph_holds_them(made):
    out, _ = made
    rows = [line for line in (out / "closures.csv").read_text().splitlines() if not line.startswith("#")]
    record = json.loads((out / "map.json").read_text())
    graph = read_g2o_graph(out / "graph.g2o")
    assert len(rows) - 1 == record["closures"]["verified"] > 0
    assert sum(row.endswith(",accepted") for row in rows) == record["closures"]["accepted"]
    neighbours = record["odometry"]["neighbours_registered"]
    assert len(graph.edges) == record["n_keyframes"] - 1 + neighbours + record["closures"]["verified"]


def test_points_carry_the_stamp_of_a_scan_that_saw_them(files, made):
    cloud = open_cloud(made[0] / "cloud.ply")
    stamps = read_tum(files[0]).stamp_s
    (chunk,) = cloud.chunks()
    assert len(chunk) == json.loads((made[0] / "map.json").read_text())["points"]["cloud.ply"] > 1000
    assert chunk.stamp_s is not None
    assert np.isin(chunk.stamp_s, stamps).all()
    assert chunk.pose_index is not None
    assert np.array_equal(stamps[chunk.pose_index], chunk.stamp_s)


def test_the_summary_says_what_was_done(made):
    assert "loop closures" in made[1]
    assert "points in cloud.ply" in made[1]
    assert "warning: the odometry drifts" in made[1]


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        (MapOptions(), InputError, "give --scans or --rgbd"),
        (MapOptions(frames=FrameSource(Path("none"))), InputError, "--rgbd needs --rig"),
        (MapOptions(scans=Source(Path("none")), mesh=True), InputError, "--mesh makes its surface of RGB-D"),
        (MapOptions(scans=Source(Path("none")), cloud_voxel_m=-1.0), InputError, "--voxel -1"),
        (MapOptions(scans=Source(Path("none"))), ScanError, "none: no such file"),
        (MapOptions(scans=Source(Path("none")), format="pdf"), TrajectoryError, "unknown trajectory format"),
    ],
)
def test_what_cannot_be_mapped_is_refused_and_nothing_is_written(files, tmp_path, options, error, words):
    with pytest.raises(error, match=words):
        make_map(files[0], tmp_path / "out", options, quiet=True)
    assert not list(tmp_path.iterdir())


def test_scans_on_another_clock_leave_no_folder(files, tmp_path):
    table = tmp_path / "late.txt"
    late = Source(files[1], stamps=table)
    table.write_text("".join(f"{1e9 + k}\n" for k in range(len(files[2]))))
    with pytest.raises(ScanError, match="stamps outside the trajectory"):
        make_map(files[0], tmp_path / "out", MapOptions(scans=late), quiet=True)
    assert not (tmp_path / "out").exists()


def test_the_command_passes_its_options_on(files, tmp_path):
    app = typer.Typer()
    app.command()(map_)
    done = CliRunner().invoke(app, [str(files[0]), "--scans", str(files[1]), "--T-body-lidar", "1,2", "--quiet"])
    assert isinstance(done.exception, InputError)
    assert "expected seven numbers" in str(done.exception)


def test_settings_are_checked():
    with pytest.raises(InputError, match="odometry 'sonar', expected one of lidar"):
        MapSettings(odometry="sonar")
    with pytest.raises(InputError, match="keyframe_m is -1"):
        MapSettings(keyframe_m=-1.0)
