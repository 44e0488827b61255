from pathlib import Path
from typing import Any

import numpy as np
import pytest
from data_root import data_root

from jaxgeo.errors import InputError
from jaxgeo.io import read_control_points

COLUMNS = {"stamp_s": 0, "E": 1, "N": 2, "h": 3}
SITE: dict[str, Any] = {"crs": "local", "lever_arm_m": [0.1, 0.2, 0.3], "sigma_m": 0.005, "sighting_sigma_m": 0.02}
PRISM_NAMES = [f"P{i:02d}" for i in (*range(1, 9), 8, *range(9, 19))]


def test_one_place_visited_twice() -> None:
    path = data_root() / "hilti2021/Campus_2_prism.txt"
    raw = np.loadtxt(path)
    survey, sightings = read_control_points(path, columns=COLUMNS, names=PRISM_NAMES, **SITE)
    assert survey.name == tuple(f"P{i:02d}" for i in range(1, 19))
    np.testing.assert_allclose(survey.enh_m[7], raw[7:9, 1:4].mean(axis=0), rtol=1e-15)
    np.testing.assert_array_equal(np.delete(survey.enh_m, 7, axis=0), np.delete(raw, [7, 8], axis=0)[:, 1:4])
    assert sightings.marker.tolist() == PRISM_NAMES
    np.testing.assert_array_equal(sightings.stamp_s, raw[:, 0])
    assert sightings.t_body_marker_m.tolist() == [[0.1, 0.2, 0.3]] * 19
    assert np.isnan(sightings.quat_body_marker_wxyz).all()
    np.testing.assert_array_equal(sightings.covariance, [np.diag([0.0004] * 3 + [0.0] * 3)] * 19)
    assert sightings.source[8] == "Campus_2_prism.txt:9"


def test_names_follow_the_file(tmp_path: Path) -> None:
    survey, _ = read_control_points(data_root() / "hilti2021/Basement_1_pole.txt", columns=COLUMNS, **SITE)
    assert survey.name == ("P01", "P02", "P03", "P04", "P05")
    path = tmp_path / "points.csv"
    path.write_text("name,stamp_s,E,N,h\nB,1,10,20,30\nA,2,1,2,3\nB,3,10.02,20,30\n")
    survey, sightings = read_control_points(path, **SITE)
    assert survey.name == ("B", "A")
    np.testing.assert_allclose(survey.enh_m, [[10.01, 20, 30], [1, 2, 3]])
    assert sightings.marker.tolist() == ["B", "A", "B"]


@pytest.mark.parametrize(
    ("text", "change", "message"),
    [
        (
            "1 0 0 0\n2 0 0 0.2\n",
            {"names": ["A", "A"]},
            r"location 'A' \(lines 1, 2\) spreads by 0\.100 m about its mean",
        ),
        ("1 0 0 0\n2 0 0 9\n", {"names": ["A"]}, "2 rows, but 1 names; expected a name for each row"),
        ("1 0 0 0\n1 0 0 9\n", {}, r"points:2: stamp 1\.0 repeats that of line 1"),
        ("1 0 0 0\n2 0 0 9\n", {"lever_arm_m": [1, 2]}, r"lever_arm_m is \[1, 2\], expected three numbers"),
        ("1 0 0 0\n2 0 0 9\n", {"sighting_sigma_m": 0.0}, "sighting sigma is 0.0, expected a positive number"),
        ("1 0 0 0\n2 0 0 9\n", {"sigma_m": 0.0}, "sigma_m: 0.0; expected one positive number"),
        ("1 0 0 0\n2 0 0 9\n", {"crs": None}, "coordinate system is missing"),
        ("1 0 0 0\n2 0 nan 9\n", {}, "points:2: column 2 .* holds 'nan'"),
        ("1 0 0 0\n2 0 3e8 9\n", {}, "points:2: location 'P02' has the coordinate 300000000 m, beyond"),
        ("1 0 0\n2 0 0\n", {}, "column index 3, but the table has 3 columns"),
    ],
)
def test_bad_control_points(tmp_path: Path, text: str, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "points"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_control_points(path, columns=COLUMNS, **(SITE | change))
