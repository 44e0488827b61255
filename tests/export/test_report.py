"""The report: self-contained, safe, and saying what was found."""

import base64
import dataclasses
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
from export.synthetic_result import local_session, luref_session

from jaxgeo.export.number_words import LengthColumn, decimal, duration_words, length_words
from jaxgeo.export.report import report_html
from jaxgeo.export.result import HeldOut
from jaxgeo.export.verdict import verdict

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
        self.open, self.tags, self.attributes, self.words = [], [], [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

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
    assert not {"script", "link", "iframe", "object", "base"} & set(outline.tags)
    for name, value in outline.attributes:
        if name in ("src", "href", "srcset", "action", "data"):
            assert value.startswith("data:")
    assert "@import" not in page
    assert "url(" not in page
    assert "default-src 'none'" in page


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
    assert "script" not in outline.tags
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


def test_few_check_points_are_no_accuracy(page):
    text = Outline(page).text
    assert "too few to state an accuracy" in text
    assert "not to be called an accuracy" in text


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
