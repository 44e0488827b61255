"""Configs: what is read, what is refused and how, and that the dump is the config."""

from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jaxgeo.config import SessionConfig, dump_config, load_config
from jaxgeo.errors import ConfigError

BASE = {
    "name": "site_1",
    "crs": "EPSG:2169",
    "survey": {"points": {"A": {"N": 1, "E": 2.5, "h": 3}, "B": {"N": 4, "E": 5, "h": 6}}},
    "sightings": {"kind": "poses", "file": "sub/sightings.csv"},
    "trajectories": {"icp": {"file": "icp.tum", "format": "tum", "odometry": "lidar"}},
}
CORNERS = "{kind: corners, file: tags.csv, marker_size_m: {default: 0.15, 38: 0.3}, columns: {stamp_s: 0, u0: u}}"
STOPS = "{kind: control_points, file: p.txt, lever_arm_m: [0, 0, 1]}"
TRUTH = "{kind: from_trajectory, file: t.txt, format: kitti, rate_hz: 10, visits: [{location: A, row: 0}]}"


@pytest.fixture(scope="module")
def base_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "session.yaml"
    path.write_text(yaml.safe_dump(BASE))
    return path


def refusal(path, *overrides):
    with pytest.raises(ConfigError) as error:
        load_config(path, overrides)
    return str(error.value)


def test_resolves_paths_against_the_folder_of_the_config(base_path, monkeypatch):
    monkeypatch.chdir("/")
    monkeypatch.setenv("JAXGEO_DATA", "/data/root")
    config = load_config(base_path, ["trajectories.icp.file=${JAXGEO_DATA}/x/../icp.tum"])
    assert config.sightings.file == base_path.parent / "sub" / "sightings.csv"
    assert config.trajectories["icp"].file == Path("/data/root/icp.tum")


def test_relative_config_path_gives_absolute_inputs(base_path, monkeypatch):
    monkeypatch.chdir(base_path.parent)
    config = load_config("session.yaml")
    assert config.sightings.file == base_path.parent / "sub" / "sightings.csv"


def test_defaults(base_path):
    config = load_config(base_path)
    assert config.visits.gap_s == 5.0
    assert (config.noise.mode, config.noise.observations, config.noise.file) == ("learned", "both", None)
    assert config.anchors.loss == "none"
    assert (config.coarse.scale, config.coarse.gravity, config.evaluate.leave_one_out) == (True, False, True)
    assert config.survey.sigma_m == (0.01, 0.01, 0.01)
    assert config.trajectories["icp"].noise.sigma_trans_m_per_sqrt_m is None


def test_overrides_reach_everything_and_later_ones_win(base_path):
    config = load_config(
        base_path,
        [
            "seed=3",
            "seed=4",
            "visits.order=[A, B, A]",
            "noise.values.sigma_trans_m_per_sqrt_m=1e-2",
            "trajectories.icp.noise.sigma_rot_rad_per_sqrt_m=[1e-3, 2e-3, 3e-3]",
            "survey.points.007={N: 1, E: 2, h: 3}",
            f"sightings={CORNERS}",
            "sightings.marker_size_m.38=0.4",
            "rig.file=rig.yaml",
        ],
    )
    assert config.seed == 4
    assert config.visits.order == ["A", "B", "A"]
    assert config.noise.values.sigma_trans_m_per_sqrt_m == (0.01, 0.01, 0.01)
    assert config.trajectories["icp"].noise.sigma_rot_rad_per_sqrt_m == (0.001, 0.002, 0.003)
    assert list(config.survey.points) == ["A", "B", "007"]
    assert config.sightings.marker_size_m == {"default": 0.15, "38": 0.4}
    assert config.sightings.columns == {"stamp_s": 0, "u0": "u"}


def test_noise_of_another_session_is_found_beside_the_config(base_path):
    config = load_config(base_path, ["noise.file=other/noise.json"])
    assert config.noise.file == base_path.parent / "other" / "noise.json"
    assert config.noise.use == "prior"


def test_a_trajectorys_own_noise_contradicts_a_fixed_file(base_path):
    own = "trajectories.icp.noise.sigma_log_scale=0.1"
    load_config(base_path, ["noise={file: n.json}", own])
    text = refusal(base_path, "noise={file: n.json, mode: fixed, use: fixed}", own)
    assert "trajectories.icp.noise and noise.file (use: fixed) both say" in text


def test_one_number_stands_for_all_markers_and_all_axes(base_path):
    config = load_config(
        base_path, [f"sightings={CORNERS}", "sightings.marker_size_m=0.2", "rig.file=r", "survey.sigma_m=2"]
    )
    assert config.sightings.marker_size_m == {"default": 0.2}
    assert config.survey.sigma_m == (2.0, 2.0, 2.0)


def test_an_orthophoto_is_found_beside_the_config_and_needs_a_place_on_a_map(base_path):
    assert load_config(base_path).basemap is None
    assert load_config(base_path, ["basemap=site.tif"]).basemap == base_path.parent / "site.tif"
    assert "basemap: crs is local, a site frame" in refusal(base_path, "basemap=site.tif", "crs=local")


def test_whole_numbers_are_names_where_names_are_meant(base_path):
    names = ["survey.points={1: {N: 1, E: 2, h: 3}, 02: {N: 1, E: 2, h: 3}}", "visits.order=[1, 02, 1]"]
    assert load_config(base_path, names).visits.order == ["1", "02", "1"]


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        [f"sightings={CORNERS}", "rig={cameras: {cam0: {intrinsics_px: [1, 2, 3, 4], distortion: []}}}"],
        [f"sightings={STOPS}", "survey=null", "sightings.names=[A, B, A]", "origin_enh_m=[76000, 79000, 300.5]"],
        [f"sightings={TRUTH}", "survey={from_trajectory: {file: t, format: kitti, times: s, rows: {A: 0, B: 7}}}"],
        ["noise={file: n.json, trajectory: icp, mode: fixed, use: fixed}"],
        ["trajectories.icp.reference={file: r, format: euroc, t_body_reference_m: [1e-9, 2, 3]}", "crs=local"],
    ],
)
def test_dump_loads_back_to_the_same_config(base_path, tmp_path, overrides):
    config = load_config(base_path, overrides)
    again = tmp_path / "elsewhere.yaml"
    again.write_text(dump_config(config))
    assert load_config(again) == config


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
@given(
    name=st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), min_size=1, max_size=8).filter(
        str.strip
    ),
    number=st.floats(allow_nan=False, allow_infinity=False),
)
def test_any_name_and_number_survives_the_dump(tmp_path, name, number):
    points = {name: {"N": number, "E": -number, "h": 0.0}}
    path = tmp_path / "c.yaml"
    config = SessionConfig.model_validate(BASE | {"survey": {"points": points}, "visits": {"order": [name]}})
    path.write_text(dump_config(config), encoding="utf-8")
    again = load_config(path)
    assert again.survey == config.survey
    assert again.visits == config.visits


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("nam=x", "unknown key 'nam'; did you mean 'name'?"),
        ("trajectories.icp.fromat=tum", "trajectories.icp: unknown key 'fromat'; did you mean 'format'?"),
        ("sightings.lever_arm_m=[1,2,3]", "sightings: unknown key 'lever_arm_m'"),
        ("noise.values.sigma_trans=1", "did you mean 'sigma_trans_m_per_sqrt_m'?"),
        ("trajectories.icp.noise.sigma_x=1", "trajectories.icp.noise: unknown key 'sigma_x'"),
        ("crs=", "crs: found None; expected EPSG:<code>"),
        ("crs=2169", "crs: found 2169; expected EPSG:<code>"),
        ("name=../x", "name: found '../x'; it names output files"),
        ("seed=1.5", "seed: found 1.5"),
        ("seed=-1", "seed: found -1"),
        ("coarse.scale=yes", "coarse.scale: found 'yes'; expected true or false"),
        ("survey.points.A.N=true", "survey.points.A.N: found True; it should be a valid number"),
        ("survey.points.A.N=.nan", "survey.points.A.N: found nan; it should be a finite number"),
        ("survey.points.A=[1,2,3]", "survey.points.A: found [1, 2, 3]; expected a mapping"),
        ("survey.points.A.h=null", "point 'A' has no h"),
        ("survey.file=s.csv", "survey: give exactly one of file, points, from_trajectory; found file and points"),
        ("survey.points=null", "found none"),
        ("survey.columns={name: 0}", "'columns' describes a file"),
        ("survey.sigma_m=[1,2]", "survey.sigma_m: found [1, 2]; expected one number, or three"),
        ("survey.sigma_m=0", "survey.sigma_m.0: found 0; it should be greater than 0"),
        ("survey.ignore=[C]", "survey.ignore names 'C', which is not surveyed"),
        ("sightings.kind=pose", "sightings.kind: found 'pose'; expected one of corners, poses"),
        ("sightings={file: x}", "sightings: missing key 'kind'"),
        ("sightings.kind=corners", "sightings: missing key 'marker_size_m'"),
        ("sightings.kind=control_points", "sightings: missing key 'lever_arm_m'"),
        ("sightings.kind=from_trajectory", "sightings: missing key 'format'"),
        ("sightings.frame=cam0", "sightings.frame is 'cam0', a camera: give 'rig'"),
        (f"sightings={CORNERS}", "need a camera: give 'rig'"),
        ("sightings.columns={x: -1}", "sightings.columns.x: found -1"),
        ("sightings.file=", "sightings.file: found None; expected the path of a file"),
        ("sightings.file=${HOME}/x", "only ${JAXGEO_DATA} is expanded"),
        ("rig={}", "rig: give exactly one of 'file' and 'cameras'"),
        ("visits={order: [A, B], locations: {6: A}}", "visits: 'order' is for markers without ids"),
        ("visits.order=[A, b]", "visits.order names 'b', which is not surveyed; did you mean"),
        ("visits.order=[]", "visits.order"),
        ("visits.gap_s=0", "visits.gap_s: found 0"),
        ("trajectories={}", "trajectories: "),
        ("trajectories.icp.format=csv", "trajectories.icp.format: found 'csv'; it should be 'tum', 'kitti'"),
        ("trajectories.icp.format=kitti", "give exactly one of 'times' and 'rate_hz' (has neither)"),
        ("trajectories.icp.rate_hz=10", "has its own stamps: remove 'rate_hz'"),
        ("trajectories.icp.odometry=null", "trajectories.icp.odometry: found None; it should be 'lidar', 'vio'"),
        ("trajectories.a/b={}", "trajectories.a/b: found 'a/b'; it names output files"),
        ("noise.mode=guessed", "noise.mode: found 'guessed'; it should be 'learned' or 'fixed'"),
        ("noise.observations=loops", "noise.observations: found 'loops'; it should be 'both', 'anchors' or 'revisit'"),
        ("noise.use=fixed", "noise: 'use' is about the noise.json of another session: give 'file'"),
        ("noise.trajectory=icp", "noise: 'trajectory' is about the noise.json of another session: give 'file'"),
        ("noise={file: n.json, use: fixed}", "noise: use is fixed, but mode is learned: with 'mode: fixed'"),
        ("noise={file: n.json, mode: fixed}", "noise: mode is fixed, so nothing is learned"),
        (
            "noise={file: n.json, mode: fixed, use: fixed, values: {sigma_log_scale: 0.1}}",
            "noise.values and noise.file (use: fixed) both say what the noise is: remove one",
        ),
        ("anchors.loss=hubert", "anchors.loss: found 'hubert'; it should be 'none', 'huber'"),
        ("solver.max_steps=0", "solver.max_steps: found 0"),
        ("origin_enh_m=[1,2]", "origin_enh_m: found [1, 2]; expected three numbers"),
        ("seed", "--set seed: expected key=value"),
        ("a..b=1", "--set a..b=1: expected key=value"),
        ("seed=[1", "--set seed=[1: the value is not YAML"),
        ("name.sub=1", "name is 'site_1', which has no keys"),
    ],
)
def test_refuses_with_file_key_value_and_mend(base_path, override, message):
    text = refusal(base_path, override)
    assert message in text
    assert override.startswith(("seed", "a..b", "name.sub")) or str(base_path) in text
    assert "\n" not in text


@pytest.mark.parametrize("key", ["crs", "name", "survey", "sightings", "trajectories"])
def test_names_a_missing_key(tmp_path, key):
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in BASE.items() if k != key}))
    assert f"{path}: missing key {key!r}: " in refusal(path)


@pytest.mark.parametrize("kind", [STOPS, TRUTH])
@pytest.mark.parametrize("labels", ["order: [A, B]", "locations: {6: A}"])
def test_refuses_labels_for_sightings_that_name_their_locations(base_path, kind, labels):
    survey = ["survey=null"] if kind is STOPS else []
    text = refusal(base_path, f"sightings={kind}", *survey, f"visits={{{labels}}}")
    assert "name their locations: remove 'visits." in text


def test_refuses_locations_that_the_survey_lacks(base_path):
    text = refusal(base_path, f"sightings={TRUTH}", "sightings.visits=[{location: Q, row: 1}]")
    assert "sightings.visits names 'Q', which is not surveyed (known: A, B)" in text


def test_says_to_set_the_data_variable(base_path, monkeypatch):
    monkeypatch.delenv("JAXGEO_DATA", raising=False)
    assert "JAXGEO_DATA is not set" in refusal(base_path, "sightings.file=${JAXGEO_DATA}/x.csv")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "holds nothing; expected a mapping"),
        (b"- a\n- b\n", "holds list; expected a mapping"),
        (b"\xff\xfe\x00junk", "is not UTF-8 text"),
        (b"name: a\nname: b\n", "line 2, column 1: the key 'name' stands twice"),
        (b"a: &a [1, *a]\n", "line 1, column 11: an alias inside of what it stands for"),
    ],
)
def test_refuses_files_that_are_no_configs(tmp_path, content, message):
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    text = refusal(path)
    assert message in text
    assert str(path) in text


def test_refuses_a_file_that_is_not_there(tmp_path):
    assert "No such file" in refusal(tmp_path / "none.yaml")
    assert "cannot read the config" in refusal(tmp_path)
