"""`jaxgeo place` and `jaxgeo predict`: from a config to a plan, and what is refused before anything is computed."""

import json
from pathlib import Path

import numpy as np
import pytest
import typer
import yaml

from jaxgeo.cli.place import place_config, predict_config
from jaxgeo.errors import ConfigError, InputError, UndeterminedError
from jaxgeo.io import read_survey

CORNERS = """name,N,E,h
A,76839,79345,340
B,76829,79357,339
C,76821,79363,338
D,76789,79320,338
E,76804,79309,340
F,76815,79296,341
G,76838,79344,340
"""
BASE = {
    "name": "site",
    "crs": "EPSG:2169",
    "path": {"waypoints": {"file": "path.csv"}},
    "noise": {"odometry": "lidar"},
    "anchors": {"count": 4, "candidates": {"file": "path.csv"}},
    "sighting": {"range_m": 8.0, "sigma_m": 0.03, "passes": "one"},
    "search": {"watched": 16},
}


def written(folder: Path, **changes) -> Path:
    (folder / "path.csv").write_text(CORNERS)
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in (BASE | changes).items() if v is not None}))
    return path


@pytest.fixture(scope="module")
def placed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    place_config(written(folder), folder / "out", [], quiet=True)
    return folder


def plan(folder: Path) -> dict:
    return json.loads((folder / "plan.json").read_text())


def test_it_writes_every_file(placed):
    out = placed / "out"
    found = plan(out)
    assert sorted(found["files"]) == sorted(path.name for path in out.iterdir())
    assert set(found["files"]) == {"plan.json", "placement.html", "placement.png", "anchors.csv", "anchors.geojson"}
    (one,) = found["plans"]
    assert one["chosen"] == "exhaustive"
    chosen = {a["name"] for a in one["anchors"]}
    survey = read_survey(placed / "path.csv", crs="EPSG:2169", sigma_m=0.01)
    at = dict(zip(survey.name, survey.enh_m.tolist(), strict=True))
    assert len(chosen) == 4
    assert all([a["E"], a["N"], a["h"]] == pytest.approx(at[a["name"]]) for a in one["anchors"])
    assert list(found["inputs_sha256"]) == ["path.csv"]


def test_the_plan_given_back_is_foretold_the_same(placed):
    layout = {"file": str(placed / "out" / "anchors.csv")}
    config = written(placed, layout=layout)
    predict_config(config, placed / "given", [], quiet=True)
    one, two = plan(placed / "out")["plans"][0], plan(placed / "given")["plans"][0]
    assert two["chosen"] == "given"
    assert two["accuracy_m"] == pytest.approx(one["accuracy_m"], rel=1e-9)
    np.testing.assert_allclose(two["along_path"]["sigma_m"], one["along_path"]["sigma_m"], rtol=1e-9)


def test_anchors_on_one_line_do_not_fix_the_frame(tmp_path):
    (tmp_path / "line.csv").write_text("N,E,h\n0,0,0\n0,60,0\n")
    points = {name: {"N": 0.0, "E": e, "h": 0.0} for name, e in zip("ABCD", (5.0, 20.0, 40.0, 55.0), strict=True)}
    config = written(
        tmp_path, crs="local", path={"waypoints": {"file": "line.csv"}}, anchors=None, layout={"points": points}
    )
    with pytest.raises(UndeterminedError, match="the turn about the direction"):
        predict_config(config, tmp_path / "out", [], quiet=True)
    with pytest.raises(UndeterminedError, match="Add some to the layout"):
        predict_config(config, tmp_path / "out", ['layout.ignore=["A", "B"]'], quiet=True)
    assert not (tmp_path / "out").exists()


def test_what_each_command_must_be_told(tmp_path):
    with pytest.raises(ConfigError, match=r"anchors\.count is missing"):
        place_config(written(tmp_path, anchors=None), tmp_path / "out", [], quiet=True)
    with pytest.raises(ConfigError, match="no anchors are given: add 'layout"):
        predict_config(written(tmp_path), tmp_path / "out", [], quiet=True)
    with pytest.raises(InputError, match=r"layout and anchors.standing give 'A' at places 1\.000 m apart"):
        predict_config(
            written(tmp_path, anchors={"standing": {"file": "path.csv"}}),
            tmp_path / "out",
            ["layout={points: {A: {N: 76839, E: 79346, h: 340}}}"],
            quiet=True,
        )
    assert not (tmp_path / "out").exists()


def test_the_dumped_config_is_the_config(tmp_path):
    from typer.testing import CliRunner

    from jaxgeo.cli.place_command import place

    app = typer.Typer()
    app.command()(place)
    done = CliRunner().invoke(app, [str(written(tmp_path)), "--dump-config", "--set", "anchors.count=6"])
    assert done.exit_code == 0
    assert yaml.safe_load(done.stdout)["anchors"]["count"] == [6]
