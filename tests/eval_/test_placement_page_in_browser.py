"""The page of a plan in a real browser: both figures are drawn, and nothing is complained of."""

import pytest
from eval_.placement_answer import report
from export.browser import CHROMIUM, browser

from eval.placement_report.page import placement_html

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium, chromium-browser or google-chrome on the path")


def test_both_figures_are_drawn_and_the_ellipses_grow(tmp_path):
    (tmp_path / "placement.html").write_text(placement_html(report()), encoding="utf-8")
    with browser(tmp_path / "profile") as page:
        page.open(tmp_path / "placement.html", 1100)
        assert page.value("document.querySelectorAll('.either.drawn .js-plotly-plot').length") == 2
        width = "(() => { const t = document.querySelector('.plot').data.find(t => t.name.includes('ellipse'));"
        width += " const x = t.x.slice(0, 48); return Math.max(...x) - Math.min(...x); })()"
        before = page.value(width)
        page.value(
            "(() => { const i = document.querySelector('.tools input'); i.value = 0;"
            " i.dispatchEvent(new Event('input')); })()"
        )
        assert page.value(width) == pytest.approx(before / 50.0, rel=1e-3)
        assert page.complaints() == []
