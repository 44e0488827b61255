"""What a plan's files say: numbers that agree with each other and with the answer, in grid coordinates and in words."""

import csv
import dataclasses
import io
import json
import math

import cv2
import numpy as np
import pytest
from eval_.placement_answer import answer, layout, report

from eval.figures.placement_map import placement_map
from eval.placement_report.map_spec import map_spec, place_on_path
from eval.placement_report.page import placement_html
from eval.placement_report.path_colour import coloured_path
from eval.placement_report.plan_text import plan_text
from eval.placement_report.point_files import anchors_csv, anchors_geojson
from eval.placement_report.profile_spec import profile_spec
from eval.placement_report.tables import anchors_table, counts_table, layouts_table, limits_table, what_if_table
from eval.placement_report.words import better_words, gain_words, verdict_words
from jaxgeo.georef import LocalFrame
from jaxgeo.io import read_survey

WICKED = '<img src=x onerror="alert(1)">'


def plan(made):
    return json.loads(plan_text(made, ["plan.json"], {}), parse_constant=pytest.fail)


def test_the_table_is_a_survey(tmp_path):
    made = report()
    path = tmp_path / "anchors.csv"
    path.write_text(anchors_csv(made, made.answers[0]))
    survey = read_survey(path, crs="EPSG:2169", sigma_m=0.01)
    chosen = made.answers[0].chosen
    assert survey.name == chosen.name
    np.testing.assert_allclose(survey.enh_m, made.frame.to_grid(chosen.point_m), atol=5.1e-4)
    rows = csv.DictReader(line for line in io.StringIO(path.read_text()) if line[0] != "#")
    assert [row["kind"] for row in rows] == ["planned"] * 4 + ["standing"]


def test_geojson_has_both_coordinates_of_one_place():
    made = report()
    features = json.loads(anchors_geojson(made, made.answers[0]))["features"]
    grid = np.array([[f["properties"][axis] for axis in "ENh"] for f in features])
    np.testing.assert_allclose(grid, made.frame.to_grid(made.answers[0].chosen.point_m), atol=5.1e-4)
    lonlat = np.array([f["geometry"]["coordinates"] for f in features])
    np.testing.assert_allclose(made.frame.grid_to_wgs84(grid)[:, :2], lonlat[:, :2], atol=1e-8)
    assert 6.1 < lonlat[0, 0] < 6.2


def test_json_holds_the_answer_in_the_grid():
    made = report()
    found = plan(made)
    (one,) = found["plans"]
    chosen = made.answers[0].chosen
    assert (one["count"], one["chosen"]) == (4, "gradient")
    np.testing.assert_allclose([[a[x] for x in "ENh"] for a in one["anchors"]], made.frame.to_grid(chosen.point_m))
    along = one["along_path"]
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(along["sigma_m"]))), one["accuracy_m"]["path"])
    squares = sum(np.square(along[f"sigma_{axis}_m"]) for axis in "ENh")
    np.testing.assert_allclose(squares, np.square(along["sigma_m"]))
    best = {row["method"]: row["accuracy_m"]["path"] for row in one["layouts"]}
    assert one["gain_over_equal_spacing"] == pytest.approx(1.0 - best["gradient"] / best["equal spacing"])
    more, lost = one["what_if"][0], one["what_if"][2]
    assert more["E"] == pytest.approx(79320.0)
    assert (lost["change"], lost["marker"], lost["accuracy_m"]) == ("one lost", "P2", None)
    assert found["frame"]["crs"] == "EPSG:2169"


def test_words_say_what_the_numbers_do():
    made = report()
    first, second, third = verdict_words(made, made.answers[0])
    value = made.answers[0].chosen.accuracy_m
    assert f"{100 * value['path']:.1f}\u202fcm" in first
    assert f"{100 * value['worst']:.1f}\u202fcm" in first
    assert "4 anchors placed as below and 1 that stands already" in first
    assert "the plan is 9\u202f% better" in second
    assert "12 ended within" in third
    assert better_words(2.0, 1.0) == "50\u202f% better"
    assert better_words(2.0, 3.0) == "50\u202f% worse"
    assert better_words(2.0, 2.001) == "as good"
    rows = {row[0]: row[1:] for row in what_if_table(made, made.answers[0]).rows}
    assert rows["Without P2"] == ("2.6\u202fcm → frame not fixed", "–")
    assert rows["Come back to P3 after the end (+34\u202fm)"][1] == "20\u202f% better"
    assert "One more anchor, at E 79\u202f320.0, N 76\u202f841.0" in rows


def test_equal_spacing_may_be_best_or_impossible():
    even_first = answer(methods=("equal spacing", "gradient"))
    assert "is the best layout found" in gain_words(even_first)
    found = answer()
    open_frame = dataclasses.replace(found.layouts[-1], accuracy_m=dict.fromkeys(found.chosen.accuracy_m, math.inf))
    found = dataclasses.replace(found, layouts=(*found.layouts[:-1], open_frame))
    assert "would not fix the frame" in gain_words(found)
    assert layouts_table(found).rows[-1][1] == "frame not fixed"
    assert plan(report(found))["plans"][0]["layouts"][-1]["accuracy_m"]["path"] is None


def test_tables_agree_with_the_answer():
    several = (answer(3, 0), answer(4, 0))
    made = report(*several)
    assert [row[0] for row in counts_table(made).rows] == [3, 4]
    assert [row[2] for row in counts_table(made).rows] == [a.chosen.accuracy_m["path"] for a in several]
    anchors = anchors_table(made, several[1])
    assert anchors.rows[0][5] == "14, 185"  # passed again at the end
    # A component's three axes are one line, and all sources together are the whole.
    limits = limits_table(answer())
    assert sum(row[1] for row in limits.rows) == pytest.approx(10.0)
    assert limits.rows[0][0] == "odometry: random direction drift"


def test_an_anchor_that_is_not_seen_is_said_so():
    found = answer()
    blind = dataclasses.replace(found.chosen, visits=tuple(v for v in found.chosen.visits if v.location != "P2"))
    found = dataclasses.replace(found, layouts=(blind, *found.layouts[1:]))
    rows = {row[0]: row[5] for row in anchors_table(report(found), found).rows}
    assert rows["P2"] == "– (not seen)"
    assert rows["P3"] == "106"


def test_the_coloured_path_has_the_answers_sigma_at_the_watched_points():
    made = report()
    found = made.answers[0]
    way_m, position_m, _, sigma_m = coloured_path(made, found)
    expected = np.sqrt(np.trace(found.chosen.covariance_m2, axis1=1, axis2=2))
    at = np.interp(found.distance_m, way_m, sigma_m[:, 3])
    np.testing.assert_allclose(at, expected, rtol=5e-3)
    # Corners are kept: the line on the map is the path.
    np.testing.assert_allclose(np.linalg.norm(np.diff(position_m, axis=0), axis=1).sum(), made.path_length_m, rtol=1e-9)
    visit = found.chosen.visits[0]
    point = found.chosen.point_m[0] - [1.5, -1.3, 0.0]
    place = place_on_path(made, found, [visit.distance_m])[0] - made.frame.origin_enh_m
    np.testing.assert_allclose(place, point, atol=1e-6)


def test_specs_are_in_the_grid_and_linked_row_by_row():
    made = report()
    drawn, profile = map_spec(made, made.answers[0]), profile_spec(made, made.answers[0])
    assert drawn["data"][drawn["linked"]]["name"].startswith("path")
    assert profile["data"][profile["linked"]]["name"] == "all axes"
    assert len(drawn["columns"]["E"]) == len(profile["columns"]["sigma"])
    placed = next(trace for trace in drawn["data"] if trace["name"] == "anchor to be placed")
    np.testing.assert_allclose(placed["x"][0], 79315.346, atol=1e-3)
    assert {trace["name"] for trace in drawn["data"]} >= {"anchor that stands", "area allowed", "seen from here"}


def test_the_page_holds_no_text_of_the_user_as_code():
    found = answer()
    chosen = found.chosen
    named = dataclasses.replace(
        chosen,
        name=(WICKED, *chosen.name[1:]),
        visits=tuple(dataclasses.replace(v, location=WICKED) if v.location == "P1" else v for v in chosen.visits),
    )
    found = dataclasses.replace(found, layouts=(named, *found.layouts[1:]))
    html = placement_html(report(found, simulated=True, warnings=(WICKED,)))
    assert "<img src=x" not in html
    assert "SIMULATED DATA" in html


def test_the_page_of_a_prediction_and_of_a_site_frame():
    made = report(answer(4, 0, methods=("given",)), crs="local", frame=LocalFrame.create("local", np.zeros(3)))
    html = placement_html(made)
    assert "predicted accuracy of given anchors" in html
    assert "equal spacing" not in html.split("Words used")[0]
    assert plan(made)["kind"] == "prediction"
    assert "lon_deg" not in plan(made)["plans"][0]["anchors"][0]


def test_the_picture_shows_the_path_and_the_anchors():
    made = report()
    data = placement_map(made, made.answers[0]).png()
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(int)
    assert image.shape[1] == 1800
    orange = (np.abs(image - [0x00, 0x5E, 0xD5]).sum(axis=2) < 12).sum()
    dark = (np.abs(image - [0x54, 0x01, 0x44]).sum(axis=2) < 60).sum()
    assert orange > 4 * 150  # four triangles and the legend's
    assert dark > 1500
    more = dataclasses.replace(made.answers[0], layouts=(layout("gradient", np.array([0.1, 0.5, 0.8]), 0.03),))
    assert placement_map(made, more).png() != data
