"""The figures of a study: what is drawn is what was given, the same bytes every time, type that can be read."""

import dataclasses
import re

import numpy as np
import pytest
from export.synthetic_result import luref_session
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_hex
from scipy import stats

from eval.figures import (
    Picture,
    before_after_map,
    calibration_ratio,
    error_ellipses,
    held_out_by_k,
    predicted_achieved,
    trajectories_map,
    write_pictures,
)
from eval.figures.calibration_ratio import share_within
from eval.figures.ellipses import ticks
from eval.figures.predicted_achieved import ratio_band
from jaxgeo.io.orthophoto import Orthophoto

ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])
SURVEY = {"A": np.array([45.0, 39.0]), "B": np.array([57.0, 29.0]), "$D": np.array([20.0, -11.0])}
PATHS = {
    "UAV, ICP": np.column_stack([np.linspace(0, 60, 50), np.linspace(-10, 40, 50)]),
    "UGV": np.array([[0.0, 0], [60, 5]]),
}
NAN = float("nan")
BY_K = (
    np.array([6, 3, 5]),
    np.array([NAN, 12.0, 7.0]),
    np.array([NAN, 19.0, 8.0]),
    np.array([4.0, 0.5, 3.0]),
)
ELLIPSE_ERRORS = {
    "coarse": np.array([[0.5, 0.4], [9.0, 0.0], [0.1, 0.1], [0.2, 0.0]]),
    "learned": np.array([[0.10, -0.05], [0.0, 0.1], [-0.1, 0.0], [NAN, NAN]]),
}
COVARIANCE = np.array([np.diag([0.04, 0.01]), np.diag([0.02, 0.02]), np.diag([9.0, 4.0]), np.full((2, 2), NAN)])
VISITS = ("A", "B", "C", "D")


def photo() -> Orthophoto:
    rgba = np.random.default_rng(0).integers(0, 256, (40, 50, 4), dtype=np.uint8)
    return Orthophoto(rgba, (79290.0, 76780.0, 79370.0, 76850.0))


def study_map(**options) -> Picture:
    return trajectories_map(PATHS, SURVEY, ORIGIN_ENH_M, "EPSG:2169", **options)


def every_picture() -> dict[str, Picture]:
    session = luref_session(200)
    sigma = np.array([0.1, 0.2, 3.0])
    return {
        "map": study_map(simulated=True),
        "photo": study_map(orthophoto=photo(), simulated=True),
        "before_after": before_after_map(session, session.trajectories["icp"]),
        "by_k": held_out_by_k({"ICP": BY_K, "dense": BY_K}, {"ICP": BY_K}, simulated=True),
        "sigma": predicted_achieved({"ICP": (sigma, 1.1 * sigma)}, simulated=True),
        "ellipses": error_ellipses(VISITS, ELLIPSE_ERRORS, COVARIANCE, simulated=True),
        "ratio": calibration_ratio({"white": np.array([0.9, 1.1, 1.2]), "none": np.array([NAN])}),
    }


def texts(picture: Picture) -> list[str]:
    figure = picture.figure
    return [t.get_text() for t in figure.findobj(match=lambda artist: hasattr(artist, "get_text"))]


@pytest.fixture(scope="module")
def pictures() -> dict[str, Picture]:
    return every_picture()


def test_files_are_the_same_bytes_every_time(pictures, tmp_path):
    paths = write_pictures(tmp_path / "once", pictures)
    again = every_picture()
    write_pictures(tmp_path / "again", {name: again[name] for name in pictures})
    assert sorted(p.name for p in paths) == sorted(f"{n}.{f}" for n in pictures for f in ("svg", "png", "pdf"))
    for path in paths:
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name
    for name in pictures:
        assert (tmp_path / "once" / f"{name}.pdf").read_bytes().startswith(b"%PDF-")
        assert b"CreationDate" not in (tmp_path / "once" / f"{name}.pdf").read_bytes()
        assert (tmp_path / "once" / f"{name}.png").read_bytes()[1:4] == b"PNG"
        svg = (tmp_path / "once" / f"{name}.svg").read_text()
        assert "<dc:date>" not in svg
        sizes = [float(x) for x in re.findall(r"font(?:-size)?: [^;\"]*?([\d.]+)px", svg)]
        assert min(sizes) >= 9.0, name


def test_every_simulated_picture_says_so(pictures):
    for name, picture in pictures.items():
        assert any("simulated data" in text for text in texts(picture)), name
    assert not any("simulated" in text for text in texts(study_map()))


def test_nothing_is_cut_off_at_the_edge(pictures):
    for name, picture in pictures.items():
        used_in = picture.figure.get_tightbbox()
        width_in, height_in = picture.figure.get_size_inches()
        assert used_in.x0 >= 0.0, name
        assert used_in.y0 >= 0.0, name
        assert used_in.x1 <= width_in, name
        assert used_in.y1 <= height_in, name


def test_a_map_shows_each_path_over_its_halo_and_every_point():
    (axes,) = study_map().figure.axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    for name, xy in PATHS.items():
        np.testing.assert_array_equal(lines[name].get_xydata(), xy)
    halos = [line for line in axes.get_lines() if to_hex(line.get_color()) == "#ffffff"]
    assert len(halos) == len(PATHS)
    assert max(h.get_zorder() for h in halos) < min(lines[name].get_zorder() for name in PATHS)
    assert min(h.get_linewidth() for h in halos) > lines["UGV"].get_linewidth()
    np.testing.assert_array_equal(lines["surveyed point"].get_xydata(), np.array(list(SURVEY.values())))
    assert set(SURVEY) <= {t.get_text() for t in axes.texts}
    styles = {(lines[n].get_color(), str(lines[n].get_linestyle())) for n in PATHS}
    assert len(styles) == len(PATHS)


def test_a_map_has_its_photo_below_everything():
    (axes,) = study_map(orthophoto=photo()).figure.axes
    (image,) = axes.images
    np.testing.assert_array_equal(image.get_extent(), [-10.0, 70.0, -20.0, 50.0])
    assert image.get_zorder() < min(line.get_zorder() for line in axes.get_lines())


def test_a_point_far_off_the_site_does_not_shrink_the_map():
    far = SURVEY | {"base station": np.array([5000.0, 0.0]), "beside": np.array([100.0, 0.0])}
    (axes,) = trajectories_map(PATHS, far, ORIGIN_ENH_M, "EPSG:2169").figure.axes
    assert {t.get_text() for t in axes.texts} >= {*SURVEY, "beside"}
    assert "base station" not in {t.get_text() for t in axes.texts}
    assert 100.0 < axes.get_xlim()[1] < 200.0


def test_a_long_path_makes_a_small_file():
    t = np.linspace(0, 100, 60_000)
    paths = {f"path {i}": np.column_stack([20 * np.cos(t) + i, t]) for i in range(6)}
    assert len(trajectories_map(paths, {}, ORIGIN_ENH_M, "EPSG:2169").svg()) < 2_000_000


def test_errors_by_number_are_in_the_order_of_the_number_and_the_bars_end_at_the_rms():
    figure = held_out_by_k({"ICP": BY_K}).figure
    (axes,) = figure.axes
    held_out, in_sample = (line for line in axes.get_lines() if line.get_linestyle() != "None")
    np.testing.assert_array_equal(held_out.get_xdata(), [3, 5, 6])
    np.testing.assert_allclose(held_out.get_ydata(), [12.0, 7.0, NAN])
    np.testing.assert_allclose(in_sample.get_ydata(), [0.5, 3.0, 4.0])
    (bars,) = axes.collections
    tops = sorted(path.vertices[:, 1].max() for path in bars.get_paths())
    np.testing.assert_allclose(tops, [8.0, 19.0])
    assert axes.get_yscale() == "log"  # 0.5 to 19 is more than a factor of 20
    assert axes.get_ylabel() == "Error [m], log scale"


def test_a_narrow_range_of_errors_starts_at_zero():
    series = (*BY_K[:3], 2.0 + 0.0 * BY_K[3])
    (axes,) = held_out_by_k({"ICP": series}).figure.axes
    assert axes.get_yscale() == "linear"
    assert axes.get_ylim()[0] == 0.0
    assert axes.get_ylim()[1] > 19.0


def test_the_reference_study_is_hollow_and_beside():
    (axes,) = held_out_by_k({"ICP": BY_K}, {"ICP": BY_K, "other": BY_K}).figure.axes
    lines = [line for line in axes.get_lines() if line.get_linestyle() != "None"]
    assert [line.get_markerfacecolor() == "white" for line in lines] == [False, False, True, True]
    assert (lines[2].get_xdata() > lines[0].get_xdata()).all()


def test_the_band_of_the_ratio_holds_95_percent_of_errors_that_are_alike_in_all_directions():
    low, high = ratio_band()
    chi = stats.chi(3, scale=1 / np.sqrt(3))
    np.testing.assert_allclose([chi.cdf(low), chi.cdf(high)], [0.025, 0.975], atol=1e-9)


def test_the_legend_counts_the_visits_inside_the_band():
    sigma_m = np.array([1.0, 1.0, 1.0, 1.0, NAN, 1.0])
    error_m = np.array([0.1, 0.3, 1.7, 1.8, 1.0, NAN])
    figure = predicted_achieved({"ICP": (sigma_m, error_m)}).figure
    assert "ICP: 2 of 4 inside" in texts(Picture(figure))
    (axes,) = figure.axes
    points = axes.get_lines()[-1].get_xydata()
    ratio = np.sort(points[:, 1] / points[:, 0])
    np.testing.assert_allclose(ratio, [0.1, 0.3, 1.7, 1.8])
    assert axes.get_xlim() == axes.get_ylim()


def test_ellipses_lie_around_the_predicted_point_and_hold_their_share():
    errors = {"learned": ELLIPSE_ERRORS["learned"][:2]}
    figure = error_ellipses(VISITS[:2], errors, COVARIANCE[:2]).figure
    figure.draw_without_rendering()
    for axes, error_m, covariance in zip(figure.axes, errors["learned"], COVARIANCE, strict=False):
        outer, inner = (c for c in axes.collections if isinstance(c, EllipseCollection))
        for ellipse, probability in ((outer, 0.95), (inner, 0.5)):
            np.testing.assert_allclose(ellipse.get_offsets(), 100.0 * error_m[None])
            radius = 100.0 * np.sqrt(stats.chi2(2).ppf(probability) * np.sort(np.diag(covariance))[::-1])
            np.testing.assert_allclose(ellipse.get_widths()[0], 2 * radius[0], rtol=1e-6)
            np.testing.assert_allclose(ellipse.get_heights()[0], 2 * radius[1], rtol=1e-6)
        assert axes.get_xlabel() == "East [cm]"
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_what_is_far_larger_is_drawn_smaller_and_what_is_far_away_is_an_arrow():
    figure = error_ellipses(VISITS, ELLIPSE_ERRORS, COVARIANCE).figure
    a, b, c, d = figure.axes
    assert [axes.get_title(loc="right") for axes in (a, b, c, d)] == ["", "", "drawn 1 : 20", ""]
    (outer, _) = (x for x in c.collections if isinstance(x, EllipseCollection))
    np.testing.assert_allclose(outer.get_offsets(), 100.0 * ELLIPSE_ERRORS["learned"][2][None] / 20.0)
    assert outer.get_widths()[0] <= np.diff(c.get_xlim())[0]
    assert "9.00\u202fm" in [t.get_text() for t in b.texts]
    assert "9.00\u202fm" not in [t.get_text() for t in a.texts]
    assert [t.get_text() for t in d.texts] == ["no prediction"]


@pytest.mark.parametrize("half", [0.013, 1.06, 3.0, 130.0])
def test_ticks_are_round_and_keep_clear_of_the_corners(half):
    at = ticks(half)
    assert len(at) >= 3
    np.testing.assert_allclose(at, -at[::-1])
    assert at.max() <= 0.8 * half
    assert f"{np.diff(at)[0]:.0e}"[0] in "125"


def test_the_calibration_figure_counts_only_what_is_a_ratio():
    values = np.array([0.5, 0.9, 1.0, 1.4, NAN, -1.0, 0.0, np.inf])
    picture = calibration_ratio({"white drift": values, "empty": np.array([NAN])})
    words = texts(picture)
    assert "white drift\nn = 4" in words
    assert "empty\nn = 0" in words
    assert "75 %" in words
    (axes,) = picture.figure.axes
    medians = [line for line in axes.get_lines() if to_hex(line.get_color()) == "#d55e00"]
    np.testing.assert_allclose(medians[0].get_xdata(), 0.95)
    assert axes.get_xscale() == "log"


def test_share_within_a_fold_is_alike_on_both_sides():
    assert share_within(np.array([1 / 1.49, 1.49])) == 1.0
    assert share_within(np.array([1 / 1.51, 1.51])) == 0.0
    assert np.isnan(share_within(np.zeros(0)))


def test_no_arrow_leaves_the_map_before_and_after():
    session = luref_session(200)
    icp = session.trajectories["icp"]
    south = icp.anchors.surveyed_enh_m[:, 1].argmin()
    residual_m = icp.residual_coarse_m.copy()
    residual_m[south] = [0.0, -3.0, 0.0]
    figure = before_after_map(session, dataclasses.replace(icp, residual_coarse_m=residual_m)).figure
    for axes in figure.axes:
        (arrows,) = (c for c in axes.collections if hasattr(c, "U"))
        tips = arrows.get_offsets() + np.column_stack([arrows.U, arrows.V])
        assert (tips >= [axes.get_xlim()[0], axes.get_ylim()[0]]).all()
        assert (tips <= [axes.get_xlim()[1], axes.get_ylim()[1]]).all()
