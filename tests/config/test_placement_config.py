"""Configs of placements: what is read, what stands in for what is not said, what is refused and how."""

import math
from pathlib import Path

import pytest
import yaml

from jaxgeo.config import dump_config
from jaxgeo.config.load import read_config
from jaxgeo.config.placement import PlacementConfig
from jaxgeo.errors import ConfigError

BASE = {
    "name": "site",
    "crs": "epsg:2169",
    "path": {"waypoints": {"file": "sub/path.csv"}},
    "noise": {"odometry": "lidar"},
    "anchors": {"count": 5},
    "sighting": {"range_m": 8.0, "sigma_m": 0.03},
}


@pytest.fixture(scope="module")
def base_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "plan.yaml"
    path.write_text(yaml.safe_dump(BASE))
    return path


def load(path: Path, *overrides: str) -> PlacementConfig:
    return read_config(path, PlacementConfig, overrides)


def test_defaults_and_paths(base_path):
    config = load(base_path)
    assert config.crs == "EPSG:2169"
    assert config.path.waypoints.file == base_path.parent / "sub" / "path.csv"
    assert config.anchors.count == (5,)
    assert (config.criterion, config.robust) == ("path", "mixture")
    assert config.survey.sigma_m == (0.01, 0.01, 0.01)
    assert load(base_path, "anchors.count=[4, 6]").anchors.count == (4, 6)


def test_it_loads_back_from_its_own_text(base_path, tmp_path):
    layout = "layout={points: {A: {N: 1, E: 2, h: 3}, B: {N: 1, E: 2}}, height_m: 4}"
    config = load(base_path, "anchors.count=[4, 6]", "survey.sigma_m=[0.01, 0.02, 0.03]", layout)
    path = tmp_path / "dumped.yaml"
    path.write_text(dump_config(config))
    assert load(path) == config


def test_sigma_of_a_visit_from_its_sightings(base_path):
    one = "sighting={range_m: 8, sigma_one_m: 0.1, rate_hz: 5, dwell_s: 4, floor_m: 0.03}"
    assert load(base_path, one).sighting.visit_sigma_m == pytest.approx(math.sqrt(0.03**2 + 0.1**2 / 20.0))
    assert load(base_path).sighting.visit_sigma_m == 0.03


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("anchors.count=0", "anchors.count: found 0; expected a number of anchors"),
        ("anchors.count=[4, 4]", "a number stands twice"),
        ("anchors.count=true", "expected a number of anchors"),
        ("anchors.reach=3", "unknown key 'reach'; did you mean 'reach_m'?"),
        ("anchors.reach_m=-1", "anchors.reach_m: found -1"),
        ("anchors={count: 3, candidates: {file: c.csv}, reach_m: 3}", "remove 'reach_m'"),
        ("anchors={count: 3, candidates: {file: c.csv}, areas: a.geojson}", "remove 'areas'"),
        ("anchors={count: 3, candidates: {file: c.csv, points: {A: {N: 1, E: 2, h: 3}}}}", "exactly one of file"),
        ("anchors={count: 3, standing: {points: {A: {N: 1, E: 2}}}}", "point 'A' has no h"),
        ("anchors.areas_crs=grid", "give 'areas'"),
        ("anchors.height_above_path_m=9", "no anchor would be seen"),
        ("path={}", "exactly one of waypoints, trajectory, run; found none"),
        ("path.run={folder: out}", "found waypoints and run"),
        ("path={trajectory: {file: a.tum, format: tum, frame: local}}", "give 'origin_enh_m'"),
        ("path={trajectory: {file: a.txt, format: kitti}}", "exactly one of 'times' and 'rate_hz'"),
        ("noise={odometry: sonar}", "noise.odometry: found 'sonar'"),
        ("noise={}", "missing key 'odometry'"),
        ("noise={odometry: vio, trajectory: icp}", "give 'file'"),
        ("noise={odometry: vio, file: n.json, values: {sigma_log_scale: 0.1}}", "both say what the noise is"),
        ("sighting={range_m: 8}", "missing: sigma_one_m, rate_hz, dwell_s"),
        ("sighting={range_m: 8, sigma_m: 0.1, rate_hz: 5}", "remove one of the two"),
        ("sighting={range_m: 8, sigma_one_m: 0.1, rate_hz: 0.5, dwell_s: 1}", "less than one sighting"),
        ("sighting.passes=two", "sighting.passes: found 'two'"),
        ("criterion=A", "criterion: found 'A'"),
        ("search.watched=2", "search.watched: found 2"),
        ("crs=2169", "crs: found 2169"),
    ],
)
def test_what_is_refused(base_path, override, said):
    with pytest.raises(ConfigError) as error:
        load(base_path, override)
    assert str(base_path) in str(error.value)
    assert said in str(error.value)


def test_a_site_frame_has_no_place_on_earth(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(yaml.safe_dump(BASE | {"crs": "local"}))
    for override, said in (
        ("basemap=a.tif", "remove 'basemap'"),
        ("anchors={count: 3, areas: a.geojson, areas_crs: wgs84}", "no longitude"),
    ):
        with pytest.raises(ConfigError, match=said):
            load(path, override)


def test_an_empty_file_is_told_what_it_needs(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text("# nothing\n")
    with pytest.raises(ConfigError, match="expected a mapping with the keys name, crs, path, noise, sighting"):
        load(path)
