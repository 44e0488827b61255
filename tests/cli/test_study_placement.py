"""`jaxgeo study placement` on a few short sessions: files, and findings that hang together."""

import dataclasses
import json

import pytest

from jaxgeo.cli.main import main
from jaxgeo.cli.study_placement import study_placement
from jaxgeo.simulate import UAV


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory):
    out = tmp_path_factory.mktemp("study") / "placement"
    study_placement(out, 3, 0, "white", True, (dataclasses.replace(UAV, n_poses=200),))
    return out, json.loads((out / "findings.json").read_text())


def test_it_writes_tables_and_findings(found):
    out, facts = found
    names = {path.name for path in out.iterdir()}
    assert {"findings.json", "tables.md", "placement_count.csv", "placement_geometry.md"} <= names
    assert facts["simulated"] is True
    assert "simulated" in (out / "tables.md").read_text().lower()


def test_predictions_follow_the_geometry(found):
    (row,) = found[1]["findings"]
    assert row["near"] == ["B", "E"]
    assert row["ratio_predicted"] < 0.7
    assert row["ratio_predicted"] == pytest.approx(row["near_predicted_m"] / row["others_predicted_m"])
    assert [each["k"] for each in row["counts"]] == [3, 4, 5]
    assert [each["choices"] for each in row["counts"]] == [20, 15, 6]
    predicted = [each["predicted"]["value"] for each in row["counts"]]
    assert predicted == sorted(predicted, reverse=True)
    assert row["best"][1] < row["worst"][1]
    assert set(row["best"][0]) == set("ACDF")


def test_what_is_achieved_is_of_the_predicted_size(found):
    (row,) = found[1]["findings"]
    for each in row["counts"]:
        assert 0.4 < each["achieved"]["value"] / each["predicted"]["value"] < 2.5
        assert each["achieved"]["low"] <= each["achieved"]["value"] <= each["achieved"]["high"]
    assert -1.0 <= row["order"]["value"] <= 1.0


def test_an_unknown_regime_is_refused(tmp_path, capsys):
    assert main(["study", "placement", "--out", str(tmp_path / "x"), "--regimes", "pink"]) == 2
    assert "pink" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
