"""The report in a real browser: every figure is drawn, answers the pointer, and nothing is complained of."""

import dataclasses

import pytest
from export.browser import CHROMIUM, browser
from export.synthetic_result import luref_session

from jaxgeo.export.report import report_html
from jaxgeo.export.report_page import page as page_html

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium, chromium-browser or google-chrome on the path")

WICKED = '<img src=x onerror="alert(1)"><script>alert(2)</script>'
# The place of a figure's part on the screen: of the figure itself, and of a row of the trace to point at.
PLACE = """(() => {
  const div = document.querySelectorAll('.plot')[%d];
  div.scrollIntoView({ block: 'center' });
  const { left, top } = div.getBoundingClientRect();
  const { xaxis, yaxis, _size: size } = div._fullLayout;
  const { x, y } = div.data[%d];
  return [left + size.l + xaxis.l2p(x[%d]), top + size.t + yaxis.l2p(y[%d])];
})()"""
HOVER_TEXT = "[...document.querySelectorAll('.plot')[%d].querySelectorAll('.hoverlayer text')].map(t => t.textContent)"


@pytest.fixture(scope="module")
def session():
    found = luref_session(n_poses=400)
    anchors = found.trajectories["icp"].anchors
    wicked = dataclasses.replace(anchors, label=(WICKED, *anchors.label[1:]))
    icp = dataclasses.replace(found.trajectories["icp"], anchors=wicked)
    return dataclasses.replace(found, trajectories={**found.trajectories, "icp": icp})


@pytest.fixture(scope="module")
def folder(session, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    (folder / "report.html").write_text(report_html(session), encoding="utf-8")
    broken = page_html("broken", ["<p>text</p><script>document.title = 'a stranger was here'</script>"], ["oops();"])
    (folder / "broken.html").write_text(broken, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def page(folder):
    with browser(folder / "profile") as page:
        yield page


@pytest.fixture(scope="module")
def loaded(page, folder):
    """The report, at the width of a desk."""
    page.open(folder / "report.html", 1100)
    return page


@pytest.fixture
def report(loaded):
    """The report; whatever it complained of by the end of the test fails the test."""
    yield loaded
    assert loaded.complaints() == []


def test_every_figure_is_drawn_in_place_of_its_static_one(report):
    assert report.value("document.querySelectorAll('.plot').length") == 4
    drawn = "[...document.querySelectorAll('.plot')].map(p => p.querySelectorAll('svg.main-svg').length > 0)"
    assert report.value(drawn) == [True] * 4
    paths = "[...document.querySelectorAll('.plot')].map(p => p.querySelectorAll('.scatterlayer .trace path').length)"
    assert min(report.value(paths)) >= 8
    assert report.value("[...document.querySelectorAll('.static')].every(s => s.offsetHeight === 0)")
    report.call("Emulation.setEmulatedMedia", media="print")
    assert report.value("[...document.querySelectorAll('.static')].every(s => s.offsetHeight > 100)")
    assert report.value("[...document.querySelectorAll('.interactive')].every(s => s.offsetHeight === 0)")
    report.call("Emulation.setEmulatedMedia", media="")


def test_one_metre_is_as_long_on_both_axes_and_axes_show_the_grid(report):
    per_metre = "(() => { const l = document.querySelector('.plot')._fullLayout; return [l.xaxis._m, -l.yaxis._m]; })()"
    along, up = report.value(per_metre)
    assert along == pytest.approx(up, rel=1e-6)
    ticks = report.value("[...document.querySelectorAll('.plot .xtick text')].slice(0, 5).map(t => t.textContent)")
    assert all(79_290 <= float(t.replace("\u202f", "")) <= 79_370 for t in ticks)
    assert "\u202f" in ticks[0]


def test_pointing_at_the_profile_points_at_the_same_pose_of_the_plan(report):
    corrected_height, row = 3, 150
    x, y = report.value(PLACE % (1, corrected_height, row, row))
    report.point_at(x, y)
    report.wait_for(f"{HOVER_TEXT % 0}.length > 0")
    columns = report.value("JSON.parse(document.querySelector('.interactive script').textContent).columns")
    (text,) = report.value(HOVER_TEXT % 0)
    shown = next(i for i in range(145, 156) if f"stamp {columns['stamp_s'][i]:.3f} s" in text)
    assert f"E {columns['E'][shown]:,.3f} ± {columns['sigma_E'][shown]:.3f} m".replace(",", "\u202f") in text
    assert f"{columns['time_s'][shown]:.2f} s after the start" in text
    report.point_at(1, 1)
    report.wait_for(f"{HOVER_TEXT % 0}.length === 0")


def test_slider_magnifies_ellipses_and_errors_alike(report):
    moved = """(() => {
      const slider = document.querySelector('.tools input');
      slider.value = %d;
      slider.dispatchEvent(new Event('input'));
      const div = document.querySelector('.plot');
      const span = (t) => Math.max(...t.x.filter(v => v !== null)) - t.x[0];
      const arrow = div.data.find(t => t.name === 'error, anchor held out');
      return [document.querySelector('.tools output').textContent, arrow.x[1] - arrow.x[0], arrow.y[1] - arrow.y[0]];
    })()"""
    said, east, north = report.value(moved % 0)
    assert said == "true to scale"
    said_more, more_east, more_north = report.value(moved % 2)
    assert said_more == "magnified 5 times"
    assert more_east == pytest.approx(5 * east, rel=1e-6)
    assert more_north == pytest.approx(5 * north, rel=1e-6)


def test_profile_goes_by_time_and_back(report):
    state = """(() => {
      const { layout, data } = document.querySelectorAll('.plot')[1];
      return [layout.xaxis.title.text, data[3].x[399], layout.shapes.map(s => s.x0)[6], layout.xaxis.range[1]];
    })()"""
    press = "[...document.querySelectorAll('.tools button')].find(b => b.textContent === '%s').click()"
    by_distance = report.value(state)
    report.value(press % "time")
    title, last_s, visit_s, end_s = report.value(state)
    assert title == "Time after the first pose [s]"
    assert last_s == end_s == pytest.approx(0.2 * 399)
    assert visit_s == pytest.approx(0.2 * 387)
    report.value(press % "distance")
    assert report.value(state) == by_distance


def test_figures_fit_a_telephone(report, folder):
    report.open(folder / "report.html", 400)
    assert report.value("document.documentElement.scrollWidth") == 400
    assert max(report.value("[...document.querySelectorAll('.plot svg.main-svg')].map(s => s.clientWidth)")) <= 400
    report.call("Emulation.setDeviceMetricsOverride", width=900, height=900, deviceScaleFactor=1, mobile=False)
    report.wait_for("document.querySelector('.plot svg.main-svg').clientWidth > 800")


def test_users_text_stays_text(report):
    assert report.value("document.querySelectorAll('img[src=x]').length") == 0
    assert report.value("document.querySelectorAll('script:not([type])').length") == 2
    labels = report.value("document.querySelectorAll('.plot')[1].layout.shapes.map(s => s.label.text)")
    assert labels[0].startswith("&lt;img")


def test_the_console_is_heard_and_strange_scripts_do_not_run(page, folder):
    before = len(page.complaints())
    page.open(folder / "broken.html", 400)
    said = "\n".join(page.complaints()[before:])
    assert "oops is not defined" in said
    assert "Content Security Policy" in said
    assert page.value("document.title") == "broken"
