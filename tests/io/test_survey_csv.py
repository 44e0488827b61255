from pathlib import Path

import numpy as np
import pytest
from data_root import data_root
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from jaxgeo.errors import SurveyError
from jaxgeo.io import read_survey, survey_from_points

LUREF = "EPSG:2169"
A = {"N": 76839.129, "E": 79345.498, "h": 340.570}
TAGS = {"name": 0, "E": 2, "N": 3, "h": 4, "rx": 5, "ry": 6, "rz": 7, "sigma_E": 8, "sigma_N": 9, "sigma_h": 10}


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "survey.csv"
    path.write_text(text)
    return path


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
@given(
    order=st.permutations(["name", "N", "E", "h", "sigma_N", "sigma_E", "sigma_h", "remark"]),
    long_names=st.booleans(),
    separator=st.sampled_from([",", ";", "\t"]),
)
def test_names_decide_not_places(tmp_path: Path, order: list[str], long_names: bool, separator: str) -> None:
    title = {"N": "Northing [m]", "E": "EASTING", "h": "Height"} if long_names else {}
    cell = {**A, "name": "A", "sigma_N": 0.01, "sigma_E": 0.02, "sigma_h": 0.03, "remark": "9 nails"}
    text = separator.join(title.get(key, key) for key in order) + "\n" + separator.join(str(cell[key]) for key in order)
    survey = read_survey(write(tmp_path, text), crs=LUREF)
    assert survey.name == ("A",)
    assert survey.enh_m.tolist() == [[A["E"], A["N"], A["h"]]]
    assert survey.sigma_m.tolist() == [[0.02, 0.01, 0.03]]
    assert np.isnan(survey.quat_grid_marker_wxyz).all()
    assert survey.crs == LUREF


def test_a_swapped_header_swaps_the_axes(tmp_path: Path) -> None:
    row = "A,76839.129,79345.498,340.570"
    north_first = read_survey(write(tmp_path, f"name,N,E,h\n{row}"), crs=LUREF, sigma_m=0.01)
    east_first = read_survey(write(tmp_path, f"name,E,N,h\n{row}"), crs=LUREF, sigma_m=0.01)
    assert north_first.enh_m[0, [1, 0, 2]].tolist() == east_first.enh_m[0].tolist()


def test_surveyed_tags_with_their_rotations() -> None:
    path = data_root() / "tagslam/test_11/surveyed_tags.csv"
    raw = np.loadtxt(path, delimiter=",", comments="#")
    survey = read_survey(path, crs="local", columns=TAGS, sigma_floor_m=0.01, ignore=[166, "3"])
    keep = raw[:, 0] != 3
    assert survey.name == tuple(str(int(name)) for name in raw[keep, 0])
    np.testing.assert_array_equal(survey.enh_m, raw[keep, 2:5])
    np.testing.assert_array_equal(survey.sigma_m, np.maximum(raw[keep, 8:11], 0.01))
    rotation = Rotation.from_quat(survey.quat_grid_marker_wxyz, scalar_first=True)
    np.testing.assert_allclose(rotation.as_matrix(), Rotation.from_rotvec(raw[keep, 5:8]).as_matrix(), atol=1e-12)
    assert np.isnan(survey.sigma_rot_rad).all()
    sigmas = {f"sigma_r{axis}": 11 + i for i, axis in enumerate("xyz")}
    survey = read_survey(path, crs="local", columns=TAGS | sigmas)
    np.testing.assert_array_equal(survey.sigma_rot_rad, raw[:, 11:14])
    np.testing.assert_array_equal(survey.sigma_m, raw[:, 8:11])


def test_a_local_table_reads_by_its_own_header() -> None:
    survey = read_survey(data_root() / "tagslam/test_11/surveyed_tags.csv", crs="LOCAL", sigma_m=[0.01, 0.02, 0.03])
    assert survey.crs == "local"
    assert survey.name[0] == "0"
    assert survey.enh_m[0].tolist() == [0.589, 19.26, 2.289]
    assert survey.sigma_m[0].tolist() == [0.01, 0.02, 0.03]


def test_a_survey_in_the_plane_needs_a_height(tmp_path: Path) -> None:
    path = write(tmp_path, "name,N,E\nC,1,2\n")
    message = r"survey\.csv:2: location 'C' has 2 coordinate\(s\) \(E, N\); expected N, E, h in metres\. .*`height_m`"
    with pytest.raises(SurveyError, match=message):
        read_survey(path, crs=LUREF, sigma_m=0.01)
    assert read_survey(path, crs=LUREF, sigma_m=0.01, height_m=300.0).enh_m.tolist() == [[2, 1, 300]]
    with pytest.raises(SurveyError, match="survey point 'C': location 'C' has 2 coordinate"):
        survey_from_points({"C": {"N": 1, "E": 2}}, crs=LUREF, sigma_m=0.01)
    half = write(tmp_path, "name,N,E,h\nB,1,2,3\nC,1,2,\n")
    with pytest.raises(SurveyError, match=r"survey\.csv:3: location 'C' has 2 coordinate"):
        read_survey(half, crs=LUREF, sigma_m=0.01)


def test_points_of_the_config_are_the_points_of_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, "name,N,E,h,sigma_m\nA,76839.129,79345.498,340.570,0.02\n6,1,2,3,0.01\n")
    points = {"A": {**A, "sigma_m": 0.02}, 6: {"northing": 1, "E": 2, "H": 3}}
    ours, theirs = survey_from_points(points, crs="epsg:2169", sigma_m=0.01), read_survey(path, crs=LUREF)
    assert ours.name == theirs.name == ("A", "6")
    np.testing.assert_array_equal(ours.enh_m, theirs.enh_m)
    np.testing.assert_array_equal(ours.sigma_m, theirs.sigma_m)


@pytest.mark.parametrize(
    ("crs", "message"),
    [
        (None, r"coordinate system is missing: give `crs:` in the config; expected EPSG:<code>.* or local"),
        ("", "coordinate system is missing"),
        ("LUREF", "crs: 'LUREF'; expected EPSG:<code>"),
        ("EPSG:2169+", r"crs: 'EPSG:2169\+'; expected"),
    ],
)
def test_coordinate_systems(tmp_path: Path, crs: str | None, message: str) -> None:
    with pytest.raises(SurveyError, match=message):
        read_survey(write(tmp_path, "name,N,E,h\nA,1,2,3\n"), crs=crs, sigma_m=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,N,E,h\nA,1,2,3\nB,1,2,3\nA,4,5,6\n", r"survey\.csv:4: location 'A' is already given at .*survey\.csv:2"),
        ("name,N,E,h\n,1,2,3\n", r"survey\.csv:2: the location has no name"),
        ("name,a,b,c\nA,1,2,3\n", r"survey\.csv: no column for E, N; the header has name, a, b, c"),
        ("name,N,Northing,E,h\nA,1,1,2,3\n", r"survey\.csv: N is given twice, the second time as 'Northing'"),
        ("name,E,E,h\nA,1,2,3\n", r"survey\.csv: the header gives E twice, as 'E' and 'E'"),
        ("name,E,e,N,h\nA,1,2,3,4\n", r"survey\.csv: the header gives E twice, as 'E' and 'e'"),
        ("A,1,2,3\n", r"survey\.csv: no header line names the 4 columns.*columns: \{name: 0, E: 1, N: 2\}"),
        ("name,x,y,z\nA,1,2,3\n", r"columns x, y do not tell northing from easting in EPSG:2169.*crs: local"),
        ("name,N,E,h\nA,1,2e8,3\n", r"survey\.csv:2: location 'A' has the coordinate 200000000 m, beyond 1e\+08"),
        ("name,N,E,h\nA,1,inf,3\n", r"survey\.csv:2: column 'E' holds 'inf'"),
        ("name,N,E,h\nA,1,,3\n", r"survey\.csv:2: location 'A' has 2 coordinate\(s\) \(N, h\).*Add the missing"),
        ("name,N,E,h\nA,1,2 m,3\n", r"survey\.csv:2: column 'E' holds '2 m'; expected a number"),
        ("name,N,E,h,sigma_m\nA,1,2,3,0\n", r"survey\.csv:2: location 'A' has the standard deviation 0 m"),
        ("name,N,E,h,sigma_m\nA,1,2,3,-0.1\n", r"survey\.csv:2: location 'A' has the standard deviation -0\.1 m"),
        ("name,N,E,h\nA,1,2,3\n", r"survey\.csv:2: location 'A' has no standard deviation in E; add columns"),
        ("name,N,E,h,sigmaN\nA,1,2,3,0.1\n", r"column 'sigmaN' looks like a standard deviation but is not known"),
        ("name,N,E,h,sigma_m,rx,ry,rz\nA,1,2,3,1,1,,1\n", r"survey\.csv:2: location 'A': rx, ry, rz are given in part"),
        ("name,N,E,h\n", r"survey\.csv:2: a header .* but no data rows"),
    ],
)
def test_bad_surveys(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SurveyError, match=message):
        read_survey(write(tmp_path, text), crs=LUREF)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"name": 0, "N": 1, "E": 1, "h": 3}, "N and E both point at column 1"),
        ({"name": 0, "N": 1, "h": 3}, "columns: no E; given name, N, h, expected at least name, E, N"),
        ({"name": 0, "N": 1, "E": 2, "colour": 3}, "columns: unknown key 'colour'; expected some of name, E, N, h"),
        ({"name": 0, "N": 1, "E": 7}, "column index 7, but the table has 4 columns"),
        ({"name": 0, "x": 1, "y": 2}, "columns x, y do not tell northing from easting"),
    ],
)
def test_bad_maps_of_columns(tmp_path: Path, columns: dict[str, int], message: str) -> None:
    with pytest.raises(SurveyError, match=message):
        read_survey(write(tmp_path, "A,1,2,3\n"), crs=LUREF, columns=columns)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ([1, 2, 3], r"survey point 'A': \[1, 2, 3\]; expected named coordinates .* a bare list does not tell northing"),
        ({"N": 1, "E": 2, "x": 3}, "survey point 'A': unknown key 'x'"),
        ({"N": 1, "northing": 2}, "survey point 'A': N is given twice, the second time as 'northing'"),
        ({"N": "1", "E": 2, "h": 3}, "survey point 'A': N is '1', expected a finite number"),
        ({"N": float("nan"), "E": 2, "h": 3}, "survey point 'A': N is nan, expected a finite number"),
    ],
)
def test_bad_points(point: object, message: str) -> None:
    with pytest.raises(SurveyError, match=message):
        survey_from_points({"A": point}, crs=LUREF, sigma_m=0.01)  # type: ignore[dict-item]


def test_nothing_left(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="no locations left after `ignore`"):
        read_survey(write(tmp_path, "name,N,E,h\nA,1,2,3\n"), crs=LUREF, sigma_m=0.01, ignore=["A"])
    with pytest.raises(SurveyError, match="the survey has no locations"):
        survey_from_points({}, crs=LUREF, sigma_m=0.01)
    with pytest.raises(SurveyError, match=r"sigma_m: -1; expected one positive number of metres"):
        read_survey(write(tmp_path, "name,N,E,h\nA,1,2,3\n"), crs=LUREF, sigma_m=-1)
