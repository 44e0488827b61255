"""What the figures draw: ellipses and arrows of the right size, labels apart, small files."""

import dataclasses
import re

import numpy as np
import pytest
from export.synthetic_result import luref_session
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy import stats
from scipy.spatial.transform import Rotation

from jaxgeo.export.before_after import before_after
from jaxgeo.export.figure_style import COLOUR, figure_style, length_unit, thin
from jaxgeo.export.height_profile import height_asked_m, height_profile
from jaxgeo.export.held_out_plot import held_out_plot
from jaxgeo.export.label_placement import axes_box_pt, label_points
from jaxgeo.export.map_axes import ellipse_shape, fill_shape, magnification, map_figure, map_limits
from jaxgeo.export.plan_view import draw_errors, evenly_spaced_rows, plan_view
from jaxgeo.export.sigma_profile import sigma_profile

sigma = st.floats(1e-4, 10.0)


@given(sigma, sigma, st.floats(-0.95, 0.95))
def test_ellipse_is_the_contour_that_holds_95_percent(sigma_e, sigma_n, correlation):
    covariance = np.array([[sigma_e**2, correlation * sigma_e * sigma_n], [0.0, sigma_n**2]])
    covariance[1, 0] = covariance[0, 1]
    width, height, angle = (float(x[0]) for x in ellipse_shape(covariance[None]))
    turn = np.linspace(0.0, 2.0 * np.pi, 9)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    contour = np.array([[c, -s], [s, c]]) @ np.array([width / 2 * np.cos(turn), height / 2 * np.sin(turn)])
    square = np.einsum("ik,ij,jk->k", contour, np.linalg.inv(covariance), contour)
    np.testing.assert_allclose(square, stats.chi2(2).ppf(0.95), rtol=1e-5)


@settings(max_examples=30)
@given(st.floats(1e-5, 1e3), st.floats(1.0, 1e4))
def test_magnification_is_round_and_never_too_large(size_m, map_m):
    factor = magnification(np.array([size_m, np.nan, size_m]), map_m, usual=0.05, most=0.13)
    assert factor >= 1
    assert str(factor).strip("0") in ("1", "2", "5")
    assert factor == 1 or factor * size_m <= 0.05 * map_m * (1 + 1e-12)


def test_magnification_of_nothing_is_one():
    assert magnification(np.array([np.nan, 0.0]), 10.0, usual=0.05, most=0.13) == 1


@settings(max_examples=30)
@given(st.floats(0.1, 1e4), st.floats(0.1, 1e4), st.floats(0.2, 5.0))
def test_one_metre_is_as_long_on_both_axes(width_m, height_m, shape):
    low, high = fill_shape(np.zeros(2), np.array([width_m, height_m]), shape)
    span = high - low
    assert span[0] / span[1] == pytest.approx(shape)
    assert (span >= np.array([width_m, height_m]) * (1 - 1e-12)).all()


def test_error_arrows_end_where_the_error_ends():
    figure, (axes,) = map_figure(np.zeros(2), np.array([10.0, 7.0]), 1, np.zeros(3))
    start, error = np.array([[2.0, 3.0], [5.0, 5.0]]), np.array([[0.2, -0.1], [np.nan, 0.0]])
    draw_errors(axes, start, error, factor=10.0)
    figure.draw_without_rendering()
    (arrows,) = axes.collections
    assert len(arrows.get_offsets()) == 1  # the failed fold has none
    (path,) = arrows.get_paths()
    outline = arrows.get_transform().transform(path.vertices) + axes.transData.transform(start[0])
    reach = axes.transData.inverted().transform(outline) - start[0]
    tip = reach[np.argmax(reach @ np.array([0.2, -0.1]))]
    np.testing.assert_allclose(tip, [2.0, -1.0], atol=0.02)


def test_height_asked_is_surveyed_height_less_lever_arm():
    trajectory = luref_session(300).trajectories["icp"]
    anchors, pose = trajectory.anchors, trajectory.anchors.pose_index
    rotation = Rotation.from_quat(trajectory.corrected.quat_wxyz[pose], scalar_first=True)
    lever_m = rotation.apply(anchors.lever_arm_m)
    predicted = trajectory.corrected.position_m[pose] + lever_m
    trajectory = dataclasses.replace(trajectory, residual_refined_m=predicted - anchors.surveyed_enh_m + 0.25)
    np.testing.assert_allclose(height_asked_m(trajectory), anchors.surveyed_enh_m[:, 2] - lever_m[:, 2] - 0.25)


def test_labels_stay_in_the_map_and_off_each_other():
    with figure_style():
        figure = Figure(figsize=(6, 4))
        axes = figure.add_axes((0.1, 0.1, 0.85, 0.85))
        axes.set(xlim=(0, 60), ylim=(0, 40))
        point = np.array([[30.0, 20.0], [31.0, 20.0], [30.0, 21.0], [59.5, 39.5], [0.5, 0.5]])
        label_points(axes, ["10", "11", "12", "corner", "another corner"], point, point)
        figure.draw_without_rendering()
        boxes = [t.get_window_extent() for t in axes.texts]
        low, high = axes_box_pt(axes)
        scale = figure.dpi / 72.0
    for i, a in enumerate(boxes):
        assert a.x0 > low[0] * scale - 1
        assert a.x1 < high[0] * scale + 1
        assert a.y1 < high[1] * scale + 1
        assert not any(a.overlaps(b) for b in boxes[i + 1 :])


def test_ellipses_of_the_path_are_at_equal_distances():
    position = np.zeros((1000, 3))
    position[:, 0] = np.concatenate([np.zeros(500), np.linspace(0.0, 100.0, 500)])  # stands still, then walks
    rows = evenly_spaced_rows(position, 11)
    np.testing.assert_allclose(position[rows, 0], np.linspace(0.0, 100.0, 11), atol=0.25)


def test_thinning_keeps_both_ends():
    rows = thin(100_001, 500)
    assert (rows[0], rows[-1], len(rows)) == (0, 100_000, 500)
    np.testing.assert_array_equal(thin(7, 500), np.arange(7))


def test_units_follow_the_size():
    assert [length_unit(x)[1] for x in (12.0, 0.4, 0.002, np.nan)] == ["m", "cm", "mm", "m"]


def test_map_limits_of_a_single_place_are_not_empty():
    low, high = map_limits(np.ones((5, 2)))
    assert (high > low).all()


def test_colours_differ_in_lightness():
    grey = sorted(np.dot(to_rgb(COLOUR[stage]), [0.299, 0.587, 0.114]) for stage in ("coarse", "fixed", "learned"))
    assert min(np.diff(grey)) > 0.03


def test_figures_of_a_long_trajectory_stay_small():
    session = luref_session(n_poses=60_000)
    icp = session.trajectories["icp"]
    for svg in (plan_view(session, icp), before_after(session, icp), height_profile(session, icp), sigma_profile(icp)):
        assert len(svg) < 1_000_000


def test_type_is_never_smaller_than_nine():
    session = luref_session(n_poses=200)
    icp = session.trajectories["icp"]
    svgs = [plan_view(session, icp), before_after(session, icp), height_profile(session, icp)]
    for svg in (*svgs, sigma_profile(icp), held_out_plot(icp)):
        sizes = [float(x) for x in re.findall(r"font(?:-size)?: [^;\"]*?([\d.]+)px", svg.decode())]
        assert sizes
        assert min(sizes) >= 9.0
