"""Learned noise in the report: numbers a surveyor can picture, and figures that show what they are given."""

import base64
import re

import numpy as np
import pytest
from export.synthetic_learned import drift_curves, learned_noise, sigma

from jaxgeo.export.calibration_page import calibration_html
from jaxgeo.export.drift_plot import drift_plot
from jaxgeo.export.noise_section import drift_caption, factor, noise_section
from jaxgeo.export.noise_words import COMPONENT, in_words, noise_number
from jaxgeo.export.profile_plot import profile_plot
from jaxgeo.graph.components import COMPONENTS


def text_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", page)).replace("&#x27;", "'")


def polyline(svg: str, colour: str) -> np.ndarray:
    """Vertices of the longest line of a colour, in the figure's points."""
    found = re.findall(r'<path d="([^"]+)"[^>]*style="fill: none;[^"]*stroke: ' + colour, svg)
    assert found, colour
    return np.array([[float(x) for x in p] for p in re.findall(r"[ML] ([-\d.]+) ([-\d.]+)", max(found, key=len))])


def test_every_component_has_words():
    assert set(COMPONENTS) <= set(COMPONENT)


@pytest.mark.parametrize(
    ("component", "value", "shown"),
    [
        ("trans_m_per_sqrt_m", 0.02, "20.0\u202fcm"),  # sigma sqrt(100 m)
        ("rot_rad_per_sqrt_m", 0.001, "0.57°"),
        ("turn_rad_per_sqrt_rad", 0.01, "1.4°"),  # sigma sqrt(2 pi)
        ("bias_trans_m_per_m", 0.003, "30.0\u202fcm"),
        ("bias_rot_rad_per_m", 1e-5, "0.057°"),
        ("log_scale", 0.0123, "1.2\u202f%"),
        ("bounded_m", 0.004, "4.0\u202fmm"),
        ("bounded_m", float("nan"), "–"),
    ],
)
def test_a_sigma_is_shown_as_what_it_makes_of_the_path(component, value, shown):
    assert noise_number(component, value) == shown


def test_table_holds_prior_learned_and_range():
    text = text_of("".join(noise_section("icp", learned_noise(), None)))
    # prior median 40 cm known to e^3; learned 20 cm, to a factor of 2.
    assert "random position drift after 100 m 40.0 cm 20 20.0 cm 10.0 cm … 40.0 cm 2.0 100 %" in text
    assert "15 independent numbers" in text
    assert "The anchors say nothing about 'wrong scale of the path'" in text
    assert "random position drift, body x" in text.split("axis by axis")[1]


def test_names_inside_names_are_not_mistaken():
    assert in_words("about wander_log_scale, log_scale.") == (
        "about 'scale that changes on the way', 'wrong scale of the path'."
    )


def test_a_sigma_of_another_version_is_shown_as_it_is():
    learned = learned_noise()
    learned["sigmas"].append(sigma("tide_m", 0.5, 2.0))
    assert "tide_m 1 20 0.5" in text_of("".join(noise_section("icp", learned, None)))


def test_factor_words():
    assert [factor(x) for x in (0.0, np.log(2.0) / 1.96, 2.0, 1e9)] == ["1.0", "2.0", "50", "–"]


def test_user_text_is_escaped():
    learned = learned_noise() | {"sentences": ["<script>alert(1)</script>"]}
    page = calibration_html("<b>s</b>", {"<i>t</i>": learned}, {}, ("<u>w</u>",))
    assert not re.search("<(script|b|i|u)>", page)
    assert "&lt;script&gt;" in page


def test_page_says_simulated_only_where_it_is():
    assert "SIMULATED" in calibration_html("s", {"t": learned_noise()}, {"t": drift_curves()}, simulated=True)
    page = calibration_html("s", {"t": learned_noise()}, {"t": drift_curves()})
    figures = [base64.b64decode(d).decode() for d in re.findall(r'base64,([^"]+)"', page)]
    assert len(figures) == 2
    assert "simulated" not in "".join([page, *figures]).lower()


def test_drift_curves_have_their_ratio():
    svg = drift_plot(drift_curves()).decode()
    fixed, learned = polyline(svg, "#0072b2"), polyline(svg, "#d55e00")
    zero, rise = learned[0, 1], learned[0, 1] - learned[-1, 1]
    assert rise > 50  # points of a figure 3.6 inches high
    assert (zero - fixed[-1, 1]) / rise == pytest.approx(0.5, abs=0.01)


def test_drift_caption_reads_the_curve_at_100_m():
    assert (
        "Over 100\u202fm the odometry alone is expected to drift by 2.00\u202fm (one sigma; 95 % range 1.00\u202fm … "
        "4.00\u202fm); the fixed noise says 1.00\u202fm."
    ) in drift_caption(drift_curves())


def test_profile_leaves_a_gap_where_it_is_not_known():
    svg = profile_plot(learned_noise()["profiles"]).decode()
    assert len(polyline(svg, "#d55e00")) == 4  # of five points
    assert "random position drift" in svg
