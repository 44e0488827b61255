"""`jaxgeo check`: what it says of a session, sound and spoilt, and how that would be mended."""

import json

import pytest
import typer
from cli.small_session import write_small_session
from typer.testing import CliRunner

from jaxgeo.cli.check import CHECK_FILE, check_config
from jaxgeo.cli.check_command import check
from jaxgeo.cli.check_mend import mend_sentences
from jaxgeo.cli.ingest import ingest
from jaxgeo.config import load_config
from jaxgeo.errors import SightingError

ORDER = ["A", "B", "C", "D", "E", "F", "A"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("check")
    write_small_session(made)
    return made


def checked(folder, *overrides, config="poses"):
    fault = check_config(folder / f"{config}.yaml", folder / "out", list(overrides), quiet=True)
    found = json.loads((folder / "out" / CHECK_FILE).read_text())["trajectories"]["icp"]
    assert found["fault"] == fault
    return found


def test_a_sound_session(folder):
    found = checked(folder)
    assert not found["fault"]
    assert found["named"]["kind"] == "right"
    assert found["mend"] == []
    assert "mended" not in found
    assert [v["location"] for v in found["visits"]] == ORDER
    assert all(v["tested"] and v["smallest_detectable_shift_m"] > 0.0 for v in found["visits"])


def test_wrong_labels_are_named_and_what_mends_them_does(folder, capsys):
    wrong = "visits.order=[A, B, E, D, E, F, A]"
    command = typer.Typer()
    command.command()(check)
    arguments = [str(folder / "poses.yaml"), "--out", str(folder / "out"), "--set", wrong]
    done = CliRunner().invoke(command, [*arguments, "--strict"])
    assert done.exit_code == 3
    assert "icp: Found: visit 3 (E) is at C" in done.output
    assert "Labelled so: No fault found" in done.output
    said = '--set \'visits.order=["A", "B", "C", "D", "E", "F", "A"]\''
    assert said in done.output
    found = json.loads((folder / "out" / CHECK_FILE).read_text())["trajectories"]["icp"]
    assert found["named"]["visits"] == [3]
    assert not found["mended"]["fault"]
    # The line does what it says.
    (sentence,) = found["mend"]
    assert not checked(folder, sentence.split("'")[1])["fault"]
    assert CliRunner().invoke(command, [*arguments, "--quiet"]).exit_code == 0


def test_a_visit_more_than_the_order(folder):
    """C is not in the order: its visit is the extra one, and the order that is offered is the true one."""
    found = checked(folder, "visits.order=[A, B, D, E, F, A]")
    assert (found["named"]["kind"], found["named"]["visits"]) == ("extra", [3])
    assert found["named"]["places"] == ORDER
    assert found["named"]["probability"] > 0.99
    assert json.loads(found["mend"][0].split("'")[1].split("=")[1]) == ORDER


def test_a_visit_fewer_than_the_order(folder):
    found = checked(folder, "visits.order=[A, B, C, D, B, E, F, A]")
    assert (found["named"]["kind"], found["named"]["visits"]) == ("missed", [5])
    assert found["named"]["places"] == ORDER


def test_another_number_of_visits_is_refused_as_by_a_run(folder):
    (folder / "out" / CHECK_FILE).unlink(missing_ok=True)
    with pytest.raises(SightingError, match=r"7 visits were found but visits\.order names 3"):
        checked(folder, "visits.order=[A, B, C]")
    assert not (folder / "out" / CHECK_FILE).exists()


def mended(folder, config, kind, visits, places, *overrides):
    from calibration.faults import Hypothesis
    from jaxgeo.associate import make_anchors

    loaded = load_config(folder / f"{config}.yaml", overrides)
    data = ingest(loaded)
    anchors, _ = make_anchors(
        data.trajectories["icp"], data.sightings, data.visits, data.survey, origin_enh_m=data.frame.origin_enh_m
    )
    (said,) = mend_sentences(loaded, data.visits, anchors, Hypothesis(kind, visits, tuple(places)))
    return said


def test_a_visit_that_was_shifted_is_left_out_alone(folder):
    said = mended(folder, "poses", "shifted", (6,), [*ORDER[:6], ""])
    parts = said.split("'")
    assert len(ingest(load_config(folder / "poses.yaml", [parts[1], parts[3]])).visits) == 6
    # With an id of its own only the location can be.
    said = mended(folder, "corners", "shifted", (2,), ["A", "B", "", "D", "E", "F", "A"])
    assert {v.location for v in ingest(load_config(folder / "corners.yaml", [said.split("'")[1]])).visits} == set(
        "ABDEF"
    )


def test_names_that_the_order_leaves_out_stay_in_it(folder):
    ignoring = ("survey.ignore=[B]",)
    places = ["A", "D", "C", "E", "F", "A"]
    said = mended(folder, "poses", "exchanged", (1, 2), places, *ignoring)
    assert json.loads(said.split("'")[1].split("=")[1]) == ["A", "B", "D", "C", "E", "F", "A"]


def test_ids_are_exchanged_by_their_map(folder):
    said = mended(folder, "corners", "exchanged", (1, 2), ["A", "C", "B", "D", "E", "F", "A"])
    loaded = load_config(folder / "corners.yaml", [said.split("'")[1]])
    assert [visit.location for visit in ingest(loaded).visits] == ["A", "C", "B", "D", "E", "F", "A"]
    # One of the two visits of a marker elsewhere is nothing that a map of ids can say.
    said = mended(folder, "corners", "mislabelled", (6,), ["A", "B", "C", "D", "E", "F", "C"])
    assert "markers A were at several places" in said


def test_rows_are_named_by_their_stamps(folder):
    said = mended(folder, "stops", "mislabelled", (2,), ["A", "B", "F", "D", "E", "F", "A"])
    assert "sightings.names: F at 13.000 s" in said
