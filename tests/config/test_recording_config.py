"""Configs with raw sensors: trajectories that the run makes itself, and what is refused."""

from pathlib import Path
from typing import get_args

import pytest
import yaml

from jaxgeo.config import dump_config, load_config
from jaxgeo.config.inputs import ComputedTrajectoryInput, Format, TrajectoryInput
from jaxgeo.errors import ConfigError
from jaxgeo.io.trajectory_file import FORMATS

SENSORS = {
    "name": "walk",
    "crs": "EPSG:2169",
    "survey": {"file": "survey.csv"},
    "rig": {"file": "rig.yaml"},
    "scans": {"path": "scans.npz", "T_body_lidar": {"t_m": [0.0, 0.0, 0.1]}},
    "rgbd": {"path": "rgbd", "camera": "cam0"},
    "sightings": {"kind": "poses", "file": "sightings.csv"},
}
VIO = {"file": "vio.tum", "format": "tum", "odometry": "vio"}


def written(folder: Path, **changes) -> Path:
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in (SENSORS | changes).items() if v is not None}))
    return path


def test_scans_alone_give_the_studys_two_trajectories(tmp_path):
    config = load_config(written(tmp_path))
    assert [(n, t.computed) for n, t in config.trajectories.items()] == [("icp", "odometry"), ("dense", "mapping")]
    assert config.mapped_along("dense") == "icp"
    assert config.scans.path == tmp_path / "scans.npz"
    assert config.scans.T_body_lidar.quat_wxyz == (1.0, 0.0, 0.0, 0.0)


def test_it_loads_back_from_its_own_text(tmp_path):
    config = load_config(written(tmp_path, trajectories={"vio": VIO, "dense": {"computed": "mapping", "of": "vio"}}))
    again = tmp_path / "again.yaml"
    again.write_text(dump_config(config))
    assert load_config(again) == config
    assert isinstance(config.trajectories["vio"], TrajectoryInput)
    assert isinstance(config.trajectories["dense"], ComputedTrajectoryInput)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scans": None, "rgbd": None}, "missing key 'trajectories'"),
        ({"scans": None, "trajectories": {"icp": {"computed": "odometry"}}}, "trajectories.icp.computed is 'odometry'"),
        ({"scans": None, "rgbd": None, "trajectories": {"a": VIO, "b": {"computed": "mapping"}}}, "needs sensors"),
        ({"trajectories": {"dense": {"computed": "mapping"}}}, "'of' has to name another trajectory"),
        ({"trajectories": {"a": VIO, "b": {"computed": "mapping", "of": "c"}}}, "of 'c'"),
        ({"trajectories": {"a": VIO, "b": {"computed": "mapping", "of": "b"}}}, "another trajectory (there: a)"),
        ({"trajectories": {"icp": {"computed": "odometry", "of": "x"}}}, "trajectories.icp: 'of' names"),
        ({"trajectories": {"icp": {"computed": "slam"}}}, "trajectories.icp.computed: found 'slam'"),
        ({"trajectories": {"icp": {"format": "tum"}}}, "trajectories.icp: missing key 'file'"),
        ({"trajectories": {"icp": 3}}, "trajectories.icp: found 3; expected a mapping"),
        ({"rig": None}, "'rgbd' needs a camera"),
        (
            {"scans": {"path": "x", "T_body_lidar": {"quat_wxyz": [2, 0, 0, 0]}}},
            "quaternion [w, x, y, z] of length 1",
        ),
        ({"scans": {"path": "x", "T_body_lidar": {"quat_wxyz": [1, 0]}}}, "four numbers [w, x, y, z]"),
        ({"scans": {"path": "x", "rate_hz": 10, "stamps": "t.txt"}}, "both say when scans were taken"),
        ({"scans": {"path": "x", "voxel": 1}}, "scans: unknown key 'voxel'"),
        ({"rgbd": {"path": "x", "topics": {"color": "/a"}}}, "rgbd.topics"),
    ],
)
def test_what_is_refused(tmp_path, changes, said):
    with pytest.raises(ConfigError) as refusal:
        load_config(written(tmp_path, **changes))
    assert said in str(refusal.value)
    assert "config.yaml" in str(refusal.value)


def test_every_format_that_is_read_can_be_named():
    assert set(get_args(Format)) == set(FORMATS)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"format": "rtabmap-raw"}, "has no stamps"),
        ({"format": "npy"}, "has no stamps"),
        ({"format": "rtabmap-tum", "rate_hz": 10}, "has its own stamps"),
    ],
)
def test_stamps_of_other_formats(tmp_path, given, said):
    path = written(tmp_path, trajectories={"a": VIO | given})
    with pytest.raises(ConfigError, match=said):
        load_config(path)
    ok = written(tmp_path, trajectories={"a": VIO | {"format": "rtabmap"}})
    assert load_config(ok).trajectories["a"].format == "rtabmap"
