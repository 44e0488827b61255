"""Sightings of kind `images` in a config: what is read, what is refused and how."""

import pytest
import yaml

from jaxgeo.config import dump_config, load_config
from jaxgeo.errors import ConfigError

BASE = {
    "name": "site_1",
    "crs": "local",
    "survey": {"points": {"A": {"N": 1, "E": 2.5, "h": 3}}},
    "rig": {"file": "rig.yaml"},
    "sightings": {
        "kind": "images",
        "source": {"kind": "folder", "path": "cam0", "stamps": "times.csv"},
        "marker_size_m": 0.15,
    },
    "trajectories": {"icp": {"file": "icp.tum", "format": "tum", "odometry": "lidar"}},
}
HSV = "sightings.mask={hsv: {low: [170, 120, 50], high: [8, 255, 255]}, polarity: ground}"


@pytest.fixture(scope="module")
def base_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "session.yaml"
    path.write_text(yaml.safe_dump(BASE))
    return path


def refusal(path, *overrides):
    with pytest.raises(ConfigError) as error:
        load_config(path, overrides)
    return str(error.value)


def test_defaults_and_paths(base_path):
    found = load_config(base_path).sightings
    assert found.source.path == base_path.parent / "cam0"
    assert found.source.stamps == base_path.parent / "times.csv"
    assert (found.families, found.mask, found.marker_size_m) == (["apriltag_36h11"], None, {"default": 0.15})
    assert (found.time_offset_s, found.workers, found.overlays) == (0.0, 1, 12)


def test_a_mask_is_a_colour_or_a_range_whose_hue_may_wrap(base_path):
    green = load_config(base_path, ["sightings.mask=green"]).sightings.mask
    assert (green.hsv.low, green.hsv.high) == ((35, 120, 50), (85, 255, 255))
    assert load_config(base_path, ["sightings.mask={polarity: auto}"]).sightings.mask == green
    mask = load_config(base_path, [HSV]).sightings.mask
    assert (mask.hsv.low, mask.hsv.high, mask.polarity) == ((170, 120, 50), (8, 255, 255), "ground")


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        [HSV, "sightings.gates={ids: [1, 2], max_hamming: 1}", "sightings.families=[4x4_50, tag36h11]"],
        ["sightings.source={kind: bag, path: b, topics: {/cam/image_raw: cam0}}", "sightings.time_offset_s=-0.02"],
        ["sightings.source={kind: video, path: v.mp4, rate_hz: 30, start_s: 1e9, camera: left}"],
    ],
)
def test_dump_loads_back_to_the_same_config(base_path, tmp_path, overrides):
    config = load_config(base_path, overrides)
    again = tmp_path / "elsewhere.yaml"
    again.write_text(dump_config(config))
    assert load_config(again) == config


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("rig=null", "sightings of kind 'images' are pixels and need a camera: give 'rig'"),
        ("sightings.source=null", "sightings.source: found None; expected a mapping"),
        ("sightings={kind: images, source: {kind: folder, path: x}}", "sightings: missing key 'marker_size_m'"),
        ("sightings={kind: images, marker_size_m: 1}", "sightings: missing key 'source'"),
        ("sightings.source={kind: folder}", "sightings.source: missing key 'path'"),
        ("sightings.source.kind=bags", "sightings.source.kind: found 'bags'; it should be 'folder', 'video' or 'bag'"),
        ("sightings.source.topics={/a: cam0}", "'topics' says nothing about a source of kind 'folder'"),
        ("sightings.source.kind=bag", "'stamps' says nothing about a source of kind 'bag'"),
        ("sightings.source.rate_hz=2", "'stamps' and 'rate_hz' both say when"),
        ("sightings.source.start_s=2", "'start_s' is the stamp of the first of images at 'rate_hz'"),
        ("sightings.mask=purple", "sightings.mask.hsv: found 'purple'; expected green, red, blue, or a range"),
        ("sightings.mask={hsv: {low: [1, 2], high: [3, 4, 5]}}", "expected three whole numbers [H, S, V]"),
        ("sightings.mask={hsv: {low: [180, 2, 3], high: [3, 4, 5]}}", "less than or equal to 179"),
        ("sightings.mask={polarity: dark}", "sightings.mask.polarity"),
        ("sightings.familes=[a]", "unknown key 'familes'; did you mean 'families'?"),
        ("sightings.families=[]", "sightings.families: found []; expected at least one entry"),
        ("sightings.marker_size_m=0", "sightings.marker_size_m.default"),
    ],
)
def test_refusals(base_path, override, says):
    assert says in refusal(base_path, override)
