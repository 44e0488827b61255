"""The gate of wrong anchors within a run: what is said, that nothing is changed by it, and where it is left out."""

import json

import pytest
from cli.small_session import write_small_session

from jaxgeo.cli.main import main
from jaxgeo.cli.session_check import check_warnings

EXCHANGED = "visits.order=[A, E, C, D, B, F, A]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("gate")
    write_small_session(made)
    return made


def run(folder, out, *overrides) -> dict:
    options = [part for value in overrides for part in ("--set", value)]
    assert main(["run", str(folder / "poses.yaml"), "--out", str(folder / out), *options]) == 0
    return json.loads((folder / out / "metrics.json").read_text())["trajectories"]["icp"]


def test_a_sound_session_is_said_to_be_tested(folder, capsys):
    found = run(folder, "sound")
    assert found["check"]["fault"] is False
    assert len(found["check"]["gate"]["tail"]) == 7
    assert found["warnings"] == []
    assert "warning" not in capsys.readouterr().err
    page = (folder / "sound" / "report.html").read_text()
    assert "Are the anchors right?" in page
    assert "wrong anchor" in page or "No fault found" in page


def test_a_shifted_point_is_named_and_nothing_is_changed(folder, capsys):
    rows = [row.split(",") for row in (folder / "survey.csv").read_text().splitlines()]
    rows[3][1] = str(float(rows[3][1]) + 1.5)
    (folder / "shifted.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    wrong = f"survey.file={folder / 'shifted.csv'}"
    found = run(folder, "wrong", wrong)
    check = found["check"]
    assert (check["fault"], check["named"]["visits"]) == (True, [3])
    assert "Nothing was changed: every anchor was used as it is told." in check["sentences"]
    printed = capsys.readouterr().err
    assert "warning: icp: Found: visit 3 (C)" in printed
    assert "--set" in check["mend"][0]
    assert check["mend"][0] in printed
    page = (folder / "wrong" / "report.html").read_text()
    assert page.count("every anchor was used as it is told") == 2  # in its section, and among the warnings
    # All but the finding is what a run without the check gives.
    silent = run(folder, "silent", wrong, "evaluate.check=false")
    assert silent["check"] is None
    assert "Are the anchors right?" not in (folder / "silent" / "report.html").read_text()
    drop = {"check", "warnings", "timing_s"}
    assert {k: v for k, v in silent.items() if k not in drop} == {k: v for k, v in found.items() if k not in drop}
    for name in ("trajectory.tum", "anchors.csv"):
        assert (folder / "wrong" / name).read_bytes() == (folder / "silent" / name).read_bytes()


@pytest.mark.parametrize("more", [(), ("evaluate.check=false",)])
def test_a_run_that_labels_keep_from_converging_says_which(folder, capsys, more):
    options = [part for value in (EXCHANGED, *more) for part in ("--set", value)]
    assert main(["run", str(folder / "poses.yaml"), "--out", str(folder / "none"), *options]) == 3
    said = capsys.readouterr().err
    assert "did not converge" in said
    if more:
        assert "'jaxgeo check' looks for wrong anchors" in said
    else:
        assert "Found: the visits 2 (E) and 5 (B) are exchanged" in said
        assert 'visits.order=["A", "B", "C", "D", "E", "F", "A"]' in said
    assert not (folder / "none").exists()


def test_what_could_not_be_weighed_is_a_warning():
    assert check_warnings({"fault": None, "sentences": ["a", "b"], "mend": []}) == ("a b",)
    assert check_warnings({"fault": False, "sentences": ["a"], "mend": []}) == ()
    assert check_warnings(None) == ()
    assert check_warnings({"fault": True, "sentences": ["a"], "mend": ["c"]}) == ("a c",)
