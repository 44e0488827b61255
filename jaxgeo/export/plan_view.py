"""The plan view: where the trajectory ran, where the anchors are, and how sure both are."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from jaxgeo.export.basemap import PALE_OPACITY, draw_basemap
from jaxgeo.export.figure_style import (
    COLOUR,
    MAX_LINE_VERTICES,
    STAGE_LABEL,
    distance_along_m,
    figure_style,
    legend_below,
    svg_bytes,
    thin,
)
from jaxgeo.export.held_out_stats import final_stage
from jaxgeo.export.label_placement import label_points
from jaxgeo.export.map_axes import draw_ellipses, ellipse_shape, error_scale, magnification, map_figure, map_limits
from jaxgeo.export.result import SessionResult, TrajectoryResult

PATH_ELLIPSES = 30


def plan_view(result: SessionResult, trajectory: TrajectoryResult) -> bytes:
    """SVG: one-time similarity (grey), corrected path, anchors, 95 % ellipses of the path and of the held-out anchors.

    Held-out ellipses and error arrows start at the surveyed point and have one factor, so that an arrow that ends
    inside its ellipse is an error that was foretold.
    """
    with figure_style():
        corrected = trajectory.corrected.position_m
        rows = thin(len(corrected), MAX_LINE_VERTICES)
        surveyed = trajectory.anchors.surveyed_enh_m[:, :2]
        coarse = trajectory.coarse_trajectory.position_m[rows, :2]
        low, high = map_limits(np.concatenate([corrected[rows, :2], coarse, surveyed]))
        figure, (axes,) = map_figure(low, high, 1, np.asarray(result.frame.origin_enh_m))
        if result.basemap is not None:
            draw_basemap(axes, result.basemap, np.asarray(result.frame.origin_enh_m), PALE_OPACITY)
        axes.plot(*coarse.T, color=COLOUR["coarse"], linewidth=0.9, label=STAGE_LABEL["coarse"])
        axes.plot(*corrected[rows, :2].T, color=COLOUR["corrected"], linewidth=1.4, label="corrected")
        draw_ends(axes, corrected)
        factor = draw_uncertainty(axes, trajectory, float((high - low).max()))
        draw_points(axes, result, trajectory)
        places = dict(zip(trajectory.anchors.location, surveyed, strict=True))
        held_out = trajectory.held_out.get(final_stage(trajectory))
        arrows = arrow_points(surveyed, held_out.error_enh_m[:, :2], factor) if held_out else surveyed
        obstacle = np.concatenate([corrected[thin(len(corrected), 1500), :2], arrows])
        label_points(axes, list(places), np.array(list(places.values())), obstacle)
        shown = "as large as they are" if factor == 1 else f"magnified {factor} times"
        axes.set_title(f"Plan view; ellipses hold 95 %; ellipses and error arrows {shown}", loc="left")
        error_scale(axes, factor, float(np.diff(axes.get_xlim())[0]))
        legend_below(axes, 4, drop=0.5 / (figure.get_figheight() * axes.get_position().height))
        return svg_bytes(figure)


def draw_ends(axes: Axes, position_m: Float[np.ndarray, "n 3"]) -> None:
    """Start and end of the path."""
    style = {"linestyle": "none", "markeredgecolor": COLOUR["corrected"], "markerfacecolor": "white", "zorder": 5}
    axes.plot(*position_m[0, :2], marker="o", markersize=7, label="start", **style)
    axes.plot(*position_m[-1, :2], marker="s", markersize=6, label="end", **style)


def draw_uncertainty(axes: Axes, trajectory: TrajectoryResult, map_size_m: float) -> int:
    """Ellipses along the path and of the held-out anchors, and the held-out errors; the factor they are drawn with."""
    rows = evenly_spaced_rows(trajectory.corrected.position_m, PATH_ELLIPSES)
    path_covariance = trajectory.covariance[rows][:, :2, :2]
    held_out = trajectory.held_out.get(final_stage(trajectory))
    factor = plan_factor(trajectory, map_size_m)
    centre = trajectory.corrected.position_m[rows, :2]
    draw_ellipses(
        axes,
        centre,
        path_covariance,
        factor,
        facecolors="#0072B222",
        edgecolors=COLOUR["corrected"],
        linewidths=0.7,
        zorder=3,
    )
    axes.plot([], [], marker="o", markersize=9, linestyle="none", color="#0072B244", label="95 % ellipse of the path")
    if held_out:
        surveyed = trajectory.anchors.surveyed_enh_m[:, :2]
        ring = {"facecolors": "none", "edgecolors": COLOUR["error"], "linewidths": 1.1, "zorder": 4}
        draw_ellipses(axes, surveyed, held_out.covariance_m2[:, :2, :2], factor, **ring)
        draw_errors(axes, surveyed, held_out.error_enh_m[:, :2], factor)
        ring_key = {"marker": "o", "markersize": 9, "linestyle": "none", "markerfacecolor": "none"}
        axes.plot([], [], color=COLOUR["error"], label="95 % ellipse, anchor held out", **ring_key)
        axes.plot([], [], color=COLOUR["error"], linewidth=1.6, label="error, anchor held out")
    return factor


def plan_factor(trajectory: TrajectoryResult, map_size_m: float) -> int:
    """A round factor by which ellipses and held-out errors can be seen, and do not fill the map."""
    rows = evenly_spaced_rows(trajectory.corrected.position_m, PATH_ELLIPSES)
    sizes = [ellipse_shape(trajectory.covariance[rows][:, :2, :2])[0] / 2.0]
    held_out = trajectory.held_out.get(final_stage(trajectory))
    if held_out:
        usable = held_out.covariance_m2[np.isfinite(held_out.covariance_m2).all(axis=(1, 2))]
        sizes += [ellipse_shape(usable[:, :2, :2])[0] / 2.0, np.linalg.norm(held_out.error_enh_m[:, :2], axis=1)]
    return magnification(np.concatenate(sizes), map_size_m, usual=0.05, most=0.13)


def draw_errors(
    axes: Axes, start: np.ndarray, error_m: np.ndarray, factor: float, colour: str = COLOUR["error"]
) -> None:
    """Arrows from the surveyed points along the errors, magnified; rows with NaN are left out."""
    rows = np.isfinite(error_m).all(axis=1)
    if rows.any():
        axes.quiver(
            *start[rows].T,
            *(factor * error_m[rows]).T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            units="dots",
            width=1.8,
            headwidth=4.0,
            headlength=4.5,
            headaxislength=4.0,
            color=colour,
            zorder=8,
        )


def arrow_points(start: np.ndarray, error_m: np.ndarray, factor: float) -> np.ndarray:
    """Points along the arrows that `draw_errors` draws, for labels to keep clear of."""
    rows = np.isfinite(error_m).all(axis=1)
    along = np.linspace(0.0, 1.0, 6)[:, None, None]
    return (start[rows] + along * factor * error_m[rows]).reshape(-1, 2)


def draw_points(axes: Axes, result: SessionResult, trajectory: TrajectoryResult) -> None:
    """Anchors as filled triangles; other surveyed points, where they are in view, as open ones."""
    used = trajectory.anchors.surveyed_enh_m[:, :2]
    axes.plot(*used.T, marker="^", markersize=6, linestyle="none", color=COLOUR["anchor"], label="anchor", zorder=7)
    others = [p[:2] for name, p in result.survey_enh_m.items() if name not in trajectory.anchors.location]
    if others:
        style = {"marker": "^", "markersize": 5, "linestyle": "none", "markerfacecolor": "white"}
        axes.plot(*np.array(others).T, color=COLOUR["unused"], label="surveyed, not used", zorder=2, **style)


def evenly_spaced_rows(position_m: Float[np.ndarray, "n 3"], count: int) -> np.ndarray:
    """Rows of poses at about equal distances along the path."""
    distance_m = distance_along_m(position_m)
    rows = np.searchsorted(distance_m, np.linspace(0.0, distance_m[-1], count))
    return np.unique(np.clip(rows, 0, len(position_m) - 1))
