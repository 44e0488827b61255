"""The report: self-contained, safe, and saying what was found."""

import base64
import dataclasses
import hashlib
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
from export.synthetic_result import local_session, luref_session

from jaxgeo.export.interactive import interactive_scripts
from jaxgeo.export.number_words import LengthColumn, decimal, duration_words, length_words
from jaxgeo.export.report import report_html
from jaxgeo.export.result import HeldOut
from jaxgeo.export.verdict import verdict
from jaxgeo.export.what_was_done import what_was_done

WICKED = '<script>alert("1")</script> & $\\frac{ $'
VOID = {"meta", "img", "br"}


@pytest.fixture(scope="module")
def session():
    return luref_session(n_poses=300)


@pytest.fixture(scope="module")
def page(session):
    return report_html(session)


class Outline(HTMLParser):
    """Tags, attributes and text of a page; fails on tags that do not match."""

    def __init__(self, page: str):
        super().__init__()
        self.open, self.tags, self.attributes, self.words, self.scripts = [], [], [], [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag == "script":
            self.scripts.append((dict(attrs), []))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        inside_script = self.open and self.open[-1] == "script"
        (self.scripts[-1][1] if inside_script else self.words).append(data)

    @property
    def run(self) -> list[str]:
        """Scripts that a browser would run."""
        return ["".join(text) for attributes, text in self.scripts if not attributes]

    @property
    def figures(self) -> list[dict]:
        """Interactive figures, as the page's code reads them."""
        kind = {"type": "application/json"}
        return [json.loads("".join(text)) for attributes, text in self.scripts if attributes == kind]

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))


def figures(page: str) -> list[str]:
    return [base64.b64decode(d).decode() for d in re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', page)]


def replaced(old, **changes):
    return dataclasses.replace(old, **changes)


def test_page_is_well_formed_and_fetches_nothing(page):
    outline = Outline(page)
    assert outline.open == []
    assert not {"link", "iframe", "object", "base"} & set(outline.tags)
    for name, value in outline.attributes:
        assert not name.startswith("on")
        if name in ("src", "href", "srcset", "action", "data"):
            assert value.startswith("data:")
    written = page.split("<script>")[0]
    assert "@import" not in written
    assert "url(" not in written


def test_only_the_pages_own_scripts_may_run(page):
    outline = Outline(page)
    assert outline.run == list(interactive_scripts())
    assert len(outline.scripts) == 2 + len(outline.figures) == 2 + 4
    hashes = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in outline.run]
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    parts = dict(part.strip().split(" ", 1) for part in policy.split(";"))
    assert parts["default-src"] == "'none'"
    assert parts["script-src"].split() == [f"'sha256-{h}'" for h in hashes]
    assert "connect-src" not in parts


def test_light_page_has_no_script(session, page):
    light = report_html(replaced(session, config={"report": {"interactive": False}}))
    outline = Outline(light)
    assert outline.scripts == []
    assert "script-src" not in light
    assert figures(light) == figures(page)
    assert len(light) < 0.25 * len(page)


def test_extra_sections_stand_before_the_glossary(session):
    text = Outline(report_html(session, ["<h2>More of it</h2>"])).text
    assert text.index("Trajectory dense") < text.index("More of it") < text.index("Words used")


def test_figures_are_whole_svgs_without_links(page):
    drawn = figures(page)
    assert len(drawn) == 2 * 5 + 2  # and, of the learned one, its drift and its profiles
    for svg in drawn:
        root = ET.fromstring(svg)
        assert root.tag.endswith("svg")
        links = [v for e in root.iter() for k, v in e.attrib.items() if k.endswith("href")]
        assert all(v.startswith("#") for v in links)


def test_user_text_is_escaped(session):
    icp = session.trajectories["icp"]
    anchors = dataclasses.replace(icp.anchors, label=(WICKED, *icp.anchors.label[1:]))
    anchors = dataclasses.replace(anchors, location=(WICKED, *anchors.location[1:-1], WICKED))
    icp = replaced(icp, name=WICKED, anchors=anchors, warnings=(WICKED,), noise={WICKED: WICKED})
    icp = replaced(icp, revisit={WICKED: {"coarse_m": 1.0, "refined_m": 0.1}}, solver={"result": WICKED})
    icp = replaced(icp, held_out={k: replaced(v, result=(WICKED,) * 7) for k, v in icp.held_out.items()})
    wicked = replaced(session, name=WICKED, trajectories={WICKED: icp}, config={"name": WICKED}, run={WICKED: WICKED})
    outline = Outline(report_html(wicked))
    assert outline.run == list(interactive_scripts())
    assert len(outline.figures) == 2
    assert outline.open == []
    assert outline.text.count(re.sub(r"\s+", " ", WICKED)) >= 12
    assert all("<script" not in svg for svg in figures(report_html(wicked)))


def test_simulated_banner_only_for_simulated_data(page):
    assert "SIMULATED DATA" in Outline(page).text
    assert "simulated" not in Outline(report_html(local_session(60))).text.lower().replace('"simulated": false', "")


def test_figures_of_the_tables(session, page):
    text = Outline(page).text
    icp = session.trajectories["icp"]
    for value in icp.residual_coarse_m.ravel():
        assert f"{100 * value:.1f}".replace("-", "−") in text
    mean_cm = 100 * np.mean(np.linalg.norm(icp.held_out["learned"].error_enh_m, axis=1))
    assert f"Mean over visits {100 * np.mean(np.linalg.norm(icp.held_out['coarse'].error_enh_m, axis=1)):.1f}" in text
    assert f"{mean_cm:.1f}" in text
    assert "EPSG:2169" in text
    assert "9f86d081884c7d659a2feaa0c55ad015" in text
    assert "2 sightings lay outside the trajectory's time & were left out" in text


def test_few_check_points_are_no_accuracy_and_that_is_said_once(session, page, monkeypatch):
    text = Outline(page).text
    assert text.count("too few to state an accuracy") == 1
    assert "5 check points are too few" in text  # of dense: one fold failed
    assert "uncertain by about 19 percentage points" in text
    monkeypatch.setattr("jaxgeo.export.small_numbers.MIN_CHECK_POINTS", 5)
    assert "too few to state" not in Outline(report_html(session)).text


def test_anchors_stand_in_grid_coordinates_beside_their_errors(session, page):
    icp = session.trajectories["icp"]
    text = Outline(page).text
    learned = icp.held_out["learned"]
    for j, label in enumerate(icp.anchors.label):
        surveyed = session.frame.to_grid(icp.anchors.surveyed_enh_m[j])
        predicted = surveyed + learned.error_enh_m[j]
        spread = f"{100 * icp.anchors.repeatability_m[j]:.1f}"
        row = " ".join(f"{x:,.3f}".replace(",", " ") for x in surveyed)
        assert f"{label} {icp.anchors.count[j]} {spread} {row}" in text
        size = np.linalg.norm(learned.error_enh_m[j])
        sigma = np.sqrt(np.diag(learned.covariance_m2[j]))
        ratio = learned.error_enh_m[j] / sigma
        row = [f"{x:,.3f}".replace(",", " ") for x in predicted] + [
            f"{100 * x:.1f}" for x in (*learned.error_enh_m[j], size, *sigma)
        ]
        row += [f"{x:.1f}" for x in ratio]
        row = [x.lstrip("-") if x.strip("-0.") == "" else x.replace("-", "−") for x in row]
        assert f"{label} {' '.join(row)}" in text


def held_out(errors, sigma):
    k = len(errors)
    return HeldOut(np.asarray(errors), np.tile(sigma**2 * np.eye(3), (k, 1, 1)), ("converged",) * k)


def judged(session, fixed, coarse_m=1.0):
    icp = session.trajectories["icp"]
    coarse = HeldOut(np.full((7, 3), coarse_m), np.full((7, 3, 3), np.nan), ("closed form",) * 7)
    return verdict(replaced(icp, held_out={"coarse": coarse, "fixed": fixed}, noise={"fixed": {}}))


def test_verdict_good(session):
    found = judged(session, held_out(np.full((7, 3), 0.1), 0.1))
    assert found.level == "good"
    assert "takes off 90 % of the error" in found.sentences[0]
    assert "fits the errors" in found.sentences[1]


@pytest.mark.parametrize(
    ("error_m", "level", "words"), [(1.2, "bad", "makes it worse"), (1.0, "caution", "no difference that matters")]
)
def test_verdict_no_better_than_the_similarity(session, error_m, level, words):
    found = judged(session, held_out(np.full((7, 3), error_m), error_m))
    assert found.level == level
    assert words in found.sentences[0]


@pytest.mark.parametrize(("sigma", "words"), [(0.02, "too small"), (1.0, "too large")])
def test_verdict_on_the_uncertainty(session, sigma, words):
    found = judged(session, held_out(np.full((7, 3), 0.1), sigma))
    assert found.level == "caution"
    assert f"uncertainty is {words}" in found.sentences[1]
    assert ("5.0 times the predicted" if sigma < 0.1 else "10.0 times smaller") in found.sentences[1]


@pytest.mark.parametrize(
    ("learned_m", "words"),
    [
        (
            0.1,
            "Learning the odometry noise pays: held out 17.3\u202fcm against 34.6\u202fcm with fixed noise, 50 % less.",
        ),
        (0.2, "Learned and fixed odometry noise do equally well: held out 34.6\u202fcm against 34.6\u202fcm."),
        (0.3, "does not pay here: held out 52.0\u202fcm against 34.6\u202fcm with fixed noise, 50 % more"),
    ],
)
def test_verdict_on_learning(session, learned_m, words):
    icp = session.trajectories["icp"]
    stages = {stage: held_out(np.full((7, 3), m), m) for stage, m in (("fixed", 0.2), ("learned", learned_m))}
    errors = stages["fixed"].error_enh_m
    errors[3] = np.nan  # a visit that one of them lacks is not compared
    sentences = verdict(replaced(icp, held_out={"coarse": held_out(np.ones((7, 3)), np.nan), **stages})).sentences
    assert words in sentences[1]


def test_verdict_when_learned_is_worse_than_the_similarity(session):
    icp = session.trajectories["icp"]
    stages = {"coarse": 1.0, "fixed": 0.5, "learned": 1.5}
    found = verdict(replaced(icp, held_out={s: held_out(np.full((7, 3), m), m) for s, m in stages.items()}))
    assert found.level == "bad"
    assert "The correction, with learned noise, makes it worse, by 50 %" in found.sentences[0]
    assert "noise.mode: fixed keeps to that" in found.sentences[1]


def test_verdict_names_failed_folds(session):
    errors = np.full((7, 3), 0.1)
    errors[3] = np.nan
    found = judged(session, held_out(errors, 0.1))
    assert found.level == "caution"
    assert any("1 of 7 held-out visits have no result" in s for s in found.sentences)


def test_report_without_held_out_errors_revisits_or_reference(session):
    icp = session.trajectories["icp"]
    bare = replaced(icp, held_out={}, revisit={}, reference={}, noise={"fixed": {}}, warnings=(), drift_growth=None)
    page = report_html(replaced(session, trajectories={"icp": bare}))
    text = Outline(page).text
    assert "There is no held-out error" in text
    assert "No location was visited twice" in text
    assert len(figures(page)) == 4


def revisit_words(session, revisit):
    icp = replaced(session.trajectories["icp"], revisit=revisit)
    text = Outline(report_html(replaced(session, trajectories={"icp": icp}))).text
    return verdict(icp).sentences[-1], text


def test_what_was_done_says_where_and_with_which_noise(session):
    icp, dense = session.trajectories.values()
    learned = what_was_done(session, icp)
    assert "in EPSG:2169 (LUREF / Luxembourg TM), with 7 visits to 6 surveyed locations" in learned
    assert (
        "learned from this session; the most probable of 2 models: random drift and one wrong scale (73\u202f%)"
        in learned
    )
    assert "random position drift 20.0\u202fcm after 100 m" in learned  # 0.02 m / sqrt(m), over 100 m
    assert "wrong scale of the path 0.40\u202f% all along" in learned
    assert "body x" not in learned
    values = {"sigma_trans_m_per_sqrt_m": [0.02, 0.03, 0.02], "sigma_rot_rad_per_sqrt_m": 0.001, "sigma_log_scale": 0.0}
    fixed = what_was_done(session, replaced(dense, noise={"fixed": values}))
    assert "fixed beforehand; one sigma: random position drift 30.0\u202fcm after 100 m, random direction" in fixed
    assert "scale" not in fixed.split("fixed beforehand")[1]
    stored = what_was_done(session, replaced(dense, noise={"fixed": {"session": "spring", "trajectory": "icp"}}))
    assert "taken from session spring, trajectory icp." in stored


def test_revisits_are_judged_by_the_fold_that_held_the_location_out(session):
    """B is worse held out though A is worse with all anchors in."""
    sentence, text = revisit_words(
        session,
        {
            "A": {"coarse_m": 2.24, "refined_m": 0.05, "held_out_m": 0.30},
            "B": {"coarse_m": 1.10, "refined_m": 0.01, "held_out_m": 0.47},
        },
    )
    assert sentence == (
        "Visits to one location disagree by 47.0\u202fcm at B, the worst of 2 locations when neither visit is tied to "
        "it (one-time similarity: 1.10\u202fm; with all anchors in: 1.0\u202fcm)."
    )
    assert "A 224.0 5.0 30.0 B 110.0 1.0 47.0" in text


@pytest.mark.parametrize("gap", [{}, {"held_out_m": float("nan")}])
def test_a_revisit_without_a_held_out_figure_says_so(session, gap):
    sentence, text = revisit_words(session, {"A": {"coarse_m": 2.24, "refined_m": 0.05, **gap}})
    assert "disagree by 5.0\u202fcm at A with all anchors in, which pulls them together" in sentence
    assert "there is no held-out figure" in sentence
    assert "A 224.0 5.0 –" in text


def test_largest_revisit_gap_of_the_comparison_is_the_held_out_one(page):
    assert "2.24 m 47.0 cm" in Outline(page).text


def test_lengths_in_words():
    assert [length_words(x) for x in (1234.4, 12.34, 1.234, 0.1234, 0.00123, -0.0004, float("nan"))] == [
        "1\u202f234\u202fm",
        "12.3\u202fm",
        "1.23\u202fm",
        "12.3\u202fcm",
        "1.2\u202fmm",
        "-0.4\u202fmm",
        "–",
    ]
    assert decimal(-0.04, 1) == "0.0"
    assert decimal(-1.25, 2) == "−1.25"
    assert (duration_words(3.21), duration_words(225.0), duration_words(7265.0)) == (
        "3.2\u202fs",
        "3\u202fmin 45\u202fs",
        "2\u202fh 01\u202fmin",
    )


@pytest.mark.parametrize(
    ("largest_m", "unit", "shown"), [(12.0, "m", "0.123"), (2.0, "cm", "12.3"), (0.009, "mm", "123.4")]
)
def test_one_unit_a_table(largest_m, unit, shown):
    show = LengthColumn(np.array([largest_m, np.nan, -largest_m / 2]))
    assert (show.unit, show(0.1234), show(np.nan)) == (unit, shown, "–")
