"""`jaxgeo study paper` on sessions of few poses: every file there, the same bytes again, nothing written on failure."""

import csv
import dataclasses
import io
import json
import math
from pathlib import Path

import pytest

from eval.reference_study import EFFECT
from jaxgeo.cli.study_paper import VARYING, study_paper
from jaxgeo.errors import InputError
from jaxgeo.simulate import UAV, UGV

# The shapes of the command line's other tests.
LAYOUTS = {name: dataclasses.replace(layout, n_poses=200) for name, layout in (("uav", UAV), ("ugv", UGV))}
FEW = ("evaluate.subsets=2", "evaluate.cost=false")
TABLES = (
    "locations", "effect", "by_count", "geometry", "collinearity", "uncertainty", "noise", "absolute", "relative",
    "clouds",
)  # fmt: skip
FIGURES = ("map_uav", "map_ugv", "before_after_uav_icp", "held_out_by_k", "predicted_achieved", "ellipses_ugv_dense")


@pytest.fixture(scope="module")
def studies(tmp_path_factory) -> list[Path]:
    """The same study twice."""
    folders = [tmp_path_factory.mktemp("study") / name for name in ("one", "other")]
    for folder in folders:
        study_paper(folder, 3, None, FEW, quiet=True, layouts=LAYOUTS)
    return folders


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def rows(folder: Path, table: str) -> list[dict[str, str]]:
    lines = (folder / "tables" / f"{table}.csv").read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(io.StringIO("\n".join(line for line in lines if not line.startswith("#")))))


def test_every_table_and_figure_is_there(studies):
    files = contents(studies[0])
    for table in TABLES:
        assert {f"tables/{table}.{form}" for form in ("csv", "md", "tex")} <= set(files)
    for figure in FIGURES:
        assert {f"figures/{figure}.{form}" for form in ("svg", "png", "pdf")} <= set(files)
    assert {"report.html", "metrics.json", "run.json", "sessions/uav/config.yaml"} <= set(files)
    for table in TABLES:
        if table != "geometry":
            assert "imulated" in files[f"tables/{table}.md"].decode()
    assert "learned anew" in next(r["noise"] for r in rows(studies[0], "by_count") if r["stage"] == "learned noise")


def test_a_seed_is_a_study_bit_for_bit(studies):
    one, other = map(contents, studies)
    assert one.keys() == other.keys()
    differ = [name for name in one if one[name] != other[name] and not name.startswith(VARYING)]
    assert differ == []


def test_no_place_on_this_machine_and_no_time_is_written(studies):
    for name, content in contents(studies[0]).items():
        if not name.startswith(VARYING) and not name.endswith((".png", ".pdf")):
            assert str(studies[0].parent).encode() not in content, name


def test_the_reference_study_stands_beside_every_row_that_it_has(studies):
    found = rows(studies[0], "effect")
    beside = {
        (row["session"], row["trajectory"]): float(row["reference study (recorded) [cm]: mean"])
        for row in found
        if row["stage"] == "similarity, first visits"
    }
    assert beside == {place: pytest.approx(100 * each.loo_mean_m[0]) for place, each in EFFECT.items()}
    assert {row["stage"] for row in found} >= {"one-time similarity", "fixed noise", "learned noise", "true noise"}
    assert all(row["seed"] == "3" and "jaxgeo" in row["versions"] for row in found)


def test_what_follows_from_coordinates_alone_comes_out_exactly(studies):
    found = {row["location"]: row for row in rows(studies[0], "geometry")}
    assert [f"{float(found[name]['from their line [cm]']):.1f}" for name in "BE"] == ["201.5", "220.4"]
    assert [f"{float(found[name]['of the line [%]']):.2f}" for name in "BE"] == ["7.96", "6.21"]
    others = sorted(float(found[name]["from their line [cm]"]) for name in "ACDF")
    assert (round(others[0]), round(others[-1])) == (1014, 1803)


def test_means_are_those_of_the_sessions_own_metrics(studies):
    metrics = json.loads((studies[0] / "metrics.json").read_text(encoding="utf-8"))
    for row in rows(studies[0], "effect"):
        stage = {"one-time similarity": "coarse", "fixed noise": "fixed", "learned noise": "learned"}.get(row["stage"])
        if stage:
            loo = metrics[row["session"]]["trajectories"][row["trajectory"]]["loo"][stage]
            assert float(row["leave one location out [cm]: mean"]) == pytest.approx(100 * loo["mean_m"])


def test_choices_are_counted(studies):
    found = [row for row in rows(studies[0], "by_count") if row["stage"] == "learned noise"]
    counted = {(row["trajectory"], int(row["k"])): int(row["choices"]) for row in found}
    assert counted == {(name, k): 2 * min(2, math.comb(6, k)) for name in ("icp", "dense") for k in (6, 5, 4, 3)}


def test_clouds_agree_better_the_better_the_trajectory(studies):
    mean = "nearest neighbour: mean [cm]"
    found = {(row["trajectory"], row["stage"]): float(row[mean]) for row in rows(studies[0], "clouds")}
    assert found["(true)", "truth"] < found["icp", "learned noise"] < found["icp", "one-time similarity"]


def test_nothing_is_written_where_the_study_fails(tmp_path):
    photo = tmp_path / "photo.tif"
    photo.write_bytes(b"no TIFF")
    with pytest.raises(InputError, match=r"photo\.tif"):
        study_paper(tmp_path / "out", 3, photo, FEW, quiet=True, layouts=LAYOUTS)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["photo.tif"]
