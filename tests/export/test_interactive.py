"""What the interactive figures are given to draw: grid coordinates, errors of the right size, JSON that stays JSON."""

import base64
import dataclasses
import json

import cv2
import numpy as np
import pytest
from export.synthetic_result import SURVEY_ENH_M, local_session, luref_session
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from jaxgeo.export.figure_style import distance_along_m
from jaxgeo.export.interactive import MAX_POINTS, interactive_figure, json_block
from jaxgeo.export.interactive_path import POSE_COLUMNS, path_columns, shown_rows
from jaxgeo.export.interactive_plan import interactive_plan, outlines, plan_spec, text_positions
from jaxgeo.export.interactive_profile import interactive_profile, profile_spec
from jaxgeo.export.report import report_html
from jaxgeo.io.orthophoto import Orthophoto


@pytest.fixture(scope="module")
def session():
    return luref_session(n_poses=6001)


@pytest.fixture(scope="module")
def icp(session):
    return session.trajectories["icp"]


def trace(spec, name):
    (found,) = [t for t in spec["data"] if t["name"] == name]
    return found


def parts(broken_line):
    """{attribute: (parts, points)} of a line that NaN breaks into parts of one length."""
    length = int(np.flatnonzero(np.isnan(broken_line["dx"]))[0])
    return {key: np.asarray(value).reshape(-1, length + 1)[:, :-1] for key, value in broken_line.items()}


def test_path_is_in_grid_coordinates_and_every_anchor_is_in_it(session, icp):
    rows, columns = shown_rows(icp), path_columns(session, icp)
    assert len(rows) <= MAX_POINTS + len(icp.anchors)
    assert set(icp.anchors.pose_index) | {0, 6000} <= set(rows)
    grid_m = icp.corrected.position_m[rows] + session.frame.origin_enh_m
    np.testing.assert_allclose(np.column_stack([columns[axis] for axis in "ENh"]), grid_m, rtol=0, atol=5.1e-4)
    np.testing.assert_allclose(columns["sigma_h"], np.sqrt(icp.covariance[rows, 2, 2]), rtol=0, atol=5.1e-5)
    np.testing.assert_allclose(columns["distance_m"], distance_along_m(icp.corrected.position_m)[rows], atol=5.1e-4)
    np.testing.assert_allclose(columns["time_s"], icp.corrected.stamp_s[rows] - icp.corrected.stamp_s[0], atol=5.1e-4)
    assert set(POSE_COLUMNS) <= set(columns)


@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0), st.floats(-0.95, 0.95))
def test_outlines_hold_95_percent(sigma_e, sigma_n, correlation):
    covariance = np.array([[sigma_e**2, correlation * sigma_e * sigma_n], [0.0, sigma_n**2]])
    covariance[1, 0] = covariance[0, 1]
    drawn = parts(outlines(np.array([[5.0, 7.0]]), covariance[None]))
    way = np.stack([drawn["dx"][0], drawn["dy"][0]])
    square = np.einsum("im,ij,jm->m", way, np.linalg.inv(covariance), way)
    smallest = np.sqrt(np.linalg.eigvalsh(covariance)[0])
    np.testing.assert_allclose(square, stats.chi2(2).ppf(0.95), rtol=1e-3 / smallest)  # rounded to 0.1 mm
    assert (drawn["x"] == 5.0).all()
    assert (drawn["y"] == 7.0).all()


def test_arrows_go_from_the_survey_by_the_error_and_failed_folds_have_none(session):
    dense = session.trajectories["dense"]
    error = dense.held_out["fixed"].error_enh_m
    drawn = parts(trace(plan_spec(session, dense), "error, anchor held out")["magnified"])
    kept = [j for j in range(7) if j != 3]
    surveyed = np.array([SURVEY_ENH_M[name] for name in dense.anchors.location])[kept]
    np.testing.assert_allclose(drawn["x"], surveyed[:, [0, 0]])
    np.testing.assert_allclose(drawn["y"], surveyed[:, [1, 1]])
    np.testing.assert_allclose(drawn["dx"][:, 1], error[kept, 0], atol=5.1e-5)
    np.testing.assert_allclose(drawn["dy"][:, 1], error[kept, 1], atol=5.1e-5)
    assert (drawn["dx"][:, 0] == 0).all()


def test_hover_boxes_name_visits_coordinates_and_errors(session, icp):
    spec = plan_spec(session, icp)
    boxes = trace(spec, "anchor")["hovertext"]
    assert boxes[0] == (
        "<b>A</b> as surveyed<br>E 79\u202f345.498 m<br>N 76\u202f839.129 m<br>h 340.570 m<br>visits: A, A_revisit"
    )
    texts = [t for t in trace(spec, "error, anchor held out")["text"] if t]
    assert len(texts) == 7
    error, sigma = icp.held_out["learned"].error_enh_m[6], np.sqrt(icp.held_out["learned"].covariance_m2[6, 2, 2])
    assert texts[6].startswith("<b>A_revisit</b>, held out: ")
    assert f"dh {error[2]:.3f} m, predicted ± {sigma:.3f} m".replace("-", "−") in texts[6]


def test_slider_offers_what_it_starts_with_and_true_to_scale(session):
    for each in session.trajectories.values():
        magnify = plan_spec(session, each)["magnify"]
        assert magnify["start"] in magnify["factors"]
        assert magnify["factors"][0] == 1


def test_names_of_near_points_stand_apart():
    name, point_m = ["alpha", "beta"], np.array([[10.0, 10.0], [10.0, 10.2]])
    path_m = np.array([[0.0, 0.0], [20.0, 0.0]])
    first, second = text_positions(name, point_m, path_m)
    assert first != second
    assert {first.split()[0], second.split()[0]} <= {"top", "middle", "bottom"}


def test_profile_has_either_axis_for_every_trace(session, icp):
    spec = profile_spec(session, icp)
    columns = spec["columns"]
    assert len(spec["data"]) == 5 + 3 + 3
    for each in spec["data"]:
        y = columns[each["columns"]["y"]]
        assert [len(columns[each["columns"]["x"][axis]]) for axis in ("distance", "time")] == [len(y)] * 2
    assert spec["data"][spec["linked"]]["name"] == "corrected height"
    assert [spec["axes"][axis]["range"][1] for axis in ("distance", "time")] == [
        pytest.approx(distance_along_m(icp.corrected.position_m)[-1], abs=1e-3),
        pytest.approx(1200.0),
    ]


def test_error_against_the_reference_lies_at_its_own_poses(session, icp):
    half = {
        stage: dataclasses.replace(error, stamp_s=error.stamp_s[3000:4000], error_m=error.error_m[3000:4000])
        for stage, error in icp.reference.items()
    }
    columns = profile_spec(session, dataclasses.replace(icp, reference=half))["columns"]
    length_m = distance_along_m(icp.corrected.position_m)[3000:4000]
    np.testing.assert_allclose(columns["learned_distance_m"], length_m, atol=5.1e-4)
    np.testing.assert_allclose(columns["learned_time_s"], 0.2 * np.arange(3000, 4000), atol=5.1e-4)


def test_profile_without_reference_has_two_panels():
    session = local_session(60)
    bare = dataclasses.replace(session.trajectories["vio"], reference={})
    layout = profile_spec(session, bare)["layout"]
    assert "yaxis2" in layout
    assert "yaxis3" not in layout


def test_plan_without_held_out_errors(session, icp):
    bare = dataclasses.replace(icp, held_out={})
    assert "No location was held out." in interactive_plan(session, bare)
    assert not [t for t in plan_spec(session, bare)["data"] if "held out" in t["name"]]


def test_caption_says_what_was_thinned(session, icp):
    shown = f"Shown are {len(shown_rows(icp)):,} of 6,001 poses.".replace(",", "\u202f")
    assert shown in interactive_plan(session, icp)
    assert shown in interactive_profile(session, icp)
    assert "Shown are" not in interactive_plan(local_session(60), local_session(60).trajectories["vio"])


def test_json_cannot_end_its_script_and_holds_no_nan():
    value = {"name": "</script><!-- \u2028", "x": np.array([1.0, np.nan, np.inf]), "n": (1, [float("nan"), "µ"])}
    text = json_block(value)
    assert "<" not in text
    assert json.loads(text) == {"name": value["name"], "x": [1.0, None, None], "n": [1, [None, "µ"]]}


def test_figure_escapes_what_it_is_told():
    html = interactive_figure({}, '"><b>', "<i>", group="<u>")
    assert 'aria-label="&quot;&gt;&lt;b&gt;"' in html
    assert "<i>" not in html
    assert "<u>" not in html


def test_page_of_ten_thousand_poses_stays_below_eight_megabytes():
    page = report_html(luref_session(n_poses=10_000))
    assert 5e6 < len(page.encode()) < 8e6


def test_the_orthophoto_lies_under_the_map_in_grid_coordinates_on_white_where_it_knows_nothing(session, icp):
    rgba = np.zeros((40, 60, 4), dtype=np.uint8)
    rgba[:, :30] = (200, 30, 10, 255)
    photo = Orthophoto(rgba, (79200.0, 76700.0, 79500.0, 76900.0))
    spec = plan_spec(dataclasses.replace(session, basemap=photo), icp)
    (image,) = spec["layout"]["images"]
    assert (image["x"], image["y"], image["sizex"], image["sizey"]) == (79200.0, 76900.0, 300.0, 200.0)
    assert (image["xref"], image["yref"], image["sizing"], image["layer"]) == ("x", "y", "stretch", "below")
    data = base64.b64decode(image["source"].removeprefix("data:image/jpeg;base64,"))
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert shown.shape == (40, 60, 3)
    np.testing.assert_allclose(shown[20, 5], [200, 30, 10], atol=12)
    np.testing.assert_allclose(shown[20, 55], [255, 255, 255], atol=12)
    assert plan_spec(session, icp)["layout"]["images"] == []
