"""Unusual input that is sound: it runs, with a warning where one is due."""

import re

import pytest
from cli.bad_input.runs import run
from cli.spoil import columns, lines, replace


@pytest.mark.parametrize("name", ["poses", "corners", "stops", "truth"])
def test_the_sound_session_runs(metrics, name):
    assert metrics(name)["coarse"]["rms_m"] == pytest.approx(0.041, abs=0.001)


def test_columns_are_read_by_name_in_any_order(session, metrics):
    given = metrics()
    columns("survey.csv", lambda c: [c[0], c[2], c[1], *c[3:]])(session)
    assert (session / "survey.csv").read_text().startswith("name,E,N,h")
    swapped = metrics()
    del given["timing_s"], swapped["timing_s"]
    assert swapped == given


def test_an_origin_off_the_site_changes_nothing(metrics):
    given, far = metrics(), metrics("poses", "origin_enh_m=[0, 0, 0]")
    assert far["coarse"]["rms_m"] == pytest.approx(given["coarse"]["rms_m"], abs=1e-9)


def test_a_rounded_trajectory_runs_with_a_warning(session, capsys):
    """Four decimals, quaternions too, as KISS-ICP writes."""
    lines("icp.tum", lambda old: [" ".join(f"{float(x):.4f}" for x in line.split()) for line in old])(session)
    assert run(session, quiet=False) == 0
    warning = r"warning: icp: .*icp\.tum: quaternion norms are off by up to .*: the file was written with few decimals"
    assert re.search(warning, capsys.readouterr().err)
    assert "few decimals" in (session / "out" / "report.html").read_text()


def test_a_flat_survey_with_exchanged_axes_warns_that_the_trajectory_stands_on_its_head(session, capsys):
    columns("survey.csv", lambda c: c if c[0] == "name" else [*c[:3], "340", c[4]])(session)
    replace("survey.csv", "name,N,E", "name,E,N")(session)
    assert run(session, quiet=False) == 0
    assert "z axis points down in the grid" in capsys.readouterr().err


def test_exchanged_axes_on_flat_ground_are_refused_where_up_is_known(session, capsys):
    columns("survey.csv", lambda c: c if c[0] == "name" else [*c[:3], "340", c[4]])(session)
    replace("survey.csv", "name,N,E", "name,E,N")(session)
    assert run(session, "poses", "coarse.gravity=true") == 2
    assert "E and N seem to be exchanged" in capsys.readouterr().err
