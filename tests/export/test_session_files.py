"""The files of a session: what they hold reads back, and they appear together or not at all."""

import csv
import dataclasses
import json
import re
import sys
from pathlib import Path

import numpy as np
import pyproj
import pytest
from export.synthetic_result import local_session, luref_session

from jaxgeo.errors import ConfigError
from jaxgeo.export import session_files as module
from jaxgeo.export import write_session
from jaxgeo.export.run_file import RUN_FILE, leftovers
from jaxgeo.io.tum import read_tum


@pytest.fixture(scope="module")
def session():
    return luref_session(n_poses=300)


@pytest.fixture(scope="module")
def folder(session, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("session") / "out"
    write_session(session, out)
    return out


def only(session, name):
    return dataclasses.replace(session, trajectories={name: session.trajectories[name]})


def read_csv(path: Path) -> list[dict]:
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def files_in(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


def column(rows, name):
    return np.array([float(r[name]) for r in rows])


PER_TRAJECTORY = {"trajectory.tum", "trajectory_grid.csv", "trajectory.geojson", "anchors.csv"}
PER_SESSION = {"metrics.json", "noise.json", "report.html", "run.json"}


def test_several_trajectories_have_folders(session, folder):
    expected = PER_SESSION | {f"{t}/{f}" for t in session.trajectories for f in PER_TRAJECTORY}
    assert files_in(folder) == expected
    assert set(json.loads((folder / "run.json").read_text())["files"]) == expected


def test_one_trajectory_lies_in_the_folder_itself(session, tmp_path):
    written = write_session(only(session, "icp"), tmp_path)
    assert files_in(tmp_path) == PER_SESSION | PER_TRAJECTORY
    assert {p.relative_to(tmp_path).as_posix() for p in written} == PER_SESSION | PER_TRAJECTORY


def test_tum_reads_back_exactly(session, folder):
    got, expected = read_tum(folder / "icp/trajectory.tum"), session.trajectories["icp"].corrected
    np.testing.assert_array_equal(got.stamp_s, expected.stamp_s)
    np.testing.assert_array_equal(got.position_m, expected.position_m)
    np.testing.assert_allclose(got.quat_wxyz, expected.quat_wxyz, atol=1e-15)


def test_grid_table_reads_back_exactly(session, folder):
    rows = read_csv(folder / "icp/trajectory_grid.csv")
    result = session.trajectories["icp"]
    grid = np.column_stack([column(rows, c) for c in ("E_m", "N_m", "h_m")])
    np.testing.assert_array_equal(grid, result.corrected.position_m + np.array([79300.0, 76800.0, 300.0]))
    assert grid[0, 0] > grid[0, 1] > grid[0, 2]  # east of LUREF's walk is larger than north
    np.testing.assert_array_equal(column(rows, "stamp_s"), result.corrected.stamp_s)
    quat = np.column_stack([column(rows, f"q{c}") for c in "wxyz"])
    np.testing.assert_array_equal(quat, result.corrected.quat_wxyz)
    for name, i, j in (("EE", 0, 0), ("EN", 0, 1), ("Eh", 0, 2), ("NN", 1, 1), ("Nh", 1, 2), ("hh", 2, 2)):
        np.testing.assert_array_equal(column(rows, f"cov_{name}_m2"), result.covariance[:, i, j])
    np.testing.assert_allclose(column(rows, "sigma_rN_rad") ** 2, result.covariance[:, 4, 4], rtol=1e-14)


@pytest.mark.parametrize("name", ["trajectory.tum", "trajectory_grid.csv", "anchors.csv"])
def test_headers_state_crs_origin_and_simulation(folder, name):
    head = (folder / "icp" / name).read_text().splitlines()[:6]
    assert "SIMULATED DATA" in head[0]
    assert any("EPSG:2169" in line for line in head)
    assert any("E=79300.0 N=76800.0 h=300.0" in line for line in head)


def test_measured_data_are_not_labelled_simulated(tmp_path):
    write_session(local_session(50), tmp_path)
    assert not any("SIMULATED" in p.read_text() for p in tmp_path.rglob("*") if p.is_file())


def test_simulated_data_are_labelled_in_every_file(folder):
    for path in (p for p in folder.rglob("*") if p.is_file()):
        assert re.search(r'SIMULATED DATA|"simulated": true', path.read_text()), path


def test_anchor_table(session, folder):
    rows, result = read_csv(folder / "icp/anchors.csv"), session.trajectories["icp"]
    assert [r["label"] for r in rows] == [*"ABCDEF", "A_revisit"]
    assert (float(rows[2]["surveyed_E_m"]), float(rows[2]["surveyed_N_m"])) == (79363.262, 76821.262)
    np.testing.assert_array_equal(column(rows, "refined_dh_m"), result.residual_refined_m[:, 2])
    np.testing.assert_allclose(column(rows, "coarse_norm_m"), np.linalg.norm(result.residual_coarse_m, axis=1))
    learned = result.held_out["learned"]
    np.testing.assert_array_equal(column(rows, "held_out_learned_dN_m"), learned.error_enh_m[:, 1])
    np.testing.assert_allclose(column(rows, "sigma_held_out_learned_N_m") ** 2, learned.covariance_m2[:, 1, 1])
    assert rows[3]["held_out_fixed_norm_m"] == ""
    assert rows[3]["nees_fixed"] == ""
    assert rows[3]["result_fixed"] == "not determined"


def test_anchor_table_without_a_stage_keeps_its_columns(folder):
    icp, dense = (read_csv(folder / t / "anchors.csv") for t in ("icp", "dense"))
    assert list(icp[0]) == list(dense[0])
    assert {r["held_out_learned_norm_m"] for r in dense} == {""}


def test_geojson_against_pyproj(session, folder):
    data = json.loads((folder / "icp/trajectory.geojson").read_text())
    line, *points = data["features"]
    result = session.trajectories["icp"]
    # EPSG:2169 wants northing first where the order of the authority is kept
    to_wgs84 = pyproj.Transformer.from_crs(2169, 4326)
    grid = result.corrected.position_m + np.array([79300.0, 76800.0, 300.0])
    lat, lon = to_wgs84.transform(grid[:, 1], grid[:, 0])
    got = np.array(line["geometry"]["coordinates"])
    np.testing.assert_allclose(got[:, 0], lon, atol=2e-9)
    np.testing.assert_allclose(got[:, 1], lat, atol=2e-9)
    assert line["properties"]["simulated"] is True
    assert line["properties"]["height"] == session.frame.height
    assert 6.0 < got[0, 0] < 6.5
    assert 49.4 < got[0, 1] < 50.2
    assert [p["properties"]["label"] for p in points] == [*"ABCDEF", "A_revisit"]
    assert points[0]["geometry"]["coordinates"] == points[6]["geometry"]["coordinates"]
    assert points[0]["properties"]["held_out_m"] == pytest.approx(
        np.linalg.norm(result.held_out["learned"].error_enh_m[0])
    )


def test_local_frame_has_no_geojson_and_says_why(tmp_path):
    write_session(local_session(50), tmp_path)
    assert "trajectory.geojson" not in files_in(tmp_path)
    run = json.loads((tmp_path / "run.json").read_text())
    assert "without a datum" in run["not_written"]["trajectory.geojson"]
    assert "trajectory.geojson was not written" in (tmp_path / "report.html").read_text()


def test_run_and_noise_files(session, folder):
    run = json.loads((folder / "run.json").read_text())
    assert run["config"]["seed"] == 7
    assert run["versions"]["jaxgeo"] == "0.1.0"
    assert run["frame"]["crs"] == "EPSG:2169"
    assert run["frame"]["origin_enh_m"] == [79300.0, 76800.0, 300.0]
    noise = json.loads((folder / "noise.json").read_text())["trajectories"]
    assert noise["icp"] == session.trajectories["icp"].noise


def test_same_result_gives_same_bytes(session, folder, tmp_path):
    write_session(session, tmp_path / "again")
    for name in files_in(folder):
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_an_older_run_is_replaced_and_other_files_stay(session, tmp_path):
    write_session(session, tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "icp" / "notes.txt").write_text("mine too")
    write_session(only(local_session(50), "vio"), tmp_path)
    expected = PER_SESSION | PER_TRAJECTORY - {"trajectory.geojson"} | {"notes.txt", "icp/notes.txt"}
    assert files_in(tmp_path) == expected
    assert not (tmp_path / "dense").exists()


def test_an_older_list_cannot_delete_what_is_not_ours(session, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "trajectory.tum").write_text("not ours")
    (out / "thesis.tex").write_text("not ours")
    listed = ["../trajectory.tum", "thesis.tex", str(tmp_path / "trajectory.tum"), 3]
    (out / "run.json").write_text(json.dumps({"files": listed}))
    write_session(only(session, "icp"), out)
    assert (tmp_path / "trajectory.tum").read_text() == (out / "thesis.tex").read_text() == "not ours"


@pytest.mark.parametrize("broken", ["report_html", "grid_text"])
def test_a_failure_leaves_nothing_behind(session, tmp_path, monkeypatch, broken):
    def fail(*_):
        raise RuntimeError("no more ink")

    home = "jaxgeo.export.report" if broken == "report_html" else module.__name__
    monkeypatch.setattr(sys.modules[home], broken, fail)
    with pytest.raises(RuntimeError, match="no more ink"):
        write_session(session, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_writer_killed_between_files_leaves_the_older_run_whole(session, tmp_path, monkeypatch):
    write_session(only(session, "icp"), tmp_path / "out")
    before = {name: (tmp_path / "out" / name).read_bytes() for name in files_in(tmp_path / "out")}
    write_text, calls = Path.write_text, []

    def killed(self, *args, **kwargs):
        calls.append(self)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return write_text(self, *args, **kwargs)

    monkeypatch.setattr(Path, "write_text", killed)
    with pytest.raises(KeyboardInterrupt):
        write_session(session, tmp_path / "out")
    assert {name: (tmp_path / "out" / name).read_bytes() for name in files_in(tmp_path / "out")} == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_name_that_leaves_the_folder_is_refused(session, tmp_path):
    icp = session.trajectories["icp"]
    wicked = dataclasses.replace(session, trajectories={"../up": icp, "icp": icp})
    with pytest.raises(ConfigError, match=r"'\.\./up' cannot be a folder's name"):
        write_session(wicked, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("record", ['{"files": 5}', '{"files": [["icp"], 3]}', "[]", "5", "[" * 100_000, "{", ""])
def test_a_damaged_record_of_an_older_run_makes_no_file_go(tmp_path, record):
    (tmp_path / RUN_FILE).write_text(record)
    assert leftovers(tmp_path, ["trajectory.tum"]) == []


def test_only_files_of_ours_within_the_folder_are_cleared_away(tmp_path):
    listed = ["icp/anchors.csv", "anchors.csv", "../anchors.csv", "a/b/anchors.csv", "thesis.tex"]
    (tmp_path / RUN_FILE).write_text(json.dumps({"files": listed}))
    assert leftovers(tmp_path, ["anchors.csv"]) == [tmp_path / "icp" / "anchors.csv"]
