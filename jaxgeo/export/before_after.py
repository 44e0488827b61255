"""Before and after: the one-time similarity beside the corrected trajectory, with what is left at every anchor."""

import numpy as np
from matplotlib.figure import Figure

from jaxgeo.export.figure_style import COLOUR, MAX_LINE_VERTICES, STAGE_LABEL, figure_style, svg_bytes, thin
from jaxgeo.export.label_placement import label_points
from jaxgeo.export.map_axes import error_scale, magnification, map_figure, map_limits
from jaxgeo.export.number_words import length_words
from jaxgeo.export.plan_view import arrow_points, draw_errors
from jaxgeo.export.result import SessionResult, TrajectoryResult


def before_after(result: SessionResult, trajectory: TrajectoryResult) -> bytes:
    """SVG of `before_after_figure`."""
    with figure_style():
        return svg_bytes(before_after_figure(result, trajectory))


def before_after_figure(result: SessionResult, trajectory: TrajectoryResult) -> Figure:
    """Two plan views with one scale; arrows go from the surveyed to the predicted marker, both with one factor."""
    with figure_style():
        rows = thin(len(trajectory.corrected), MAX_LINE_VERTICES)
        before = trajectory.coarse_trajectory.position_m[rows, :2]
        after = trajectory.corrected.position_m[rows, :2]
        surveyed = trajectory.anchors.surveyed_enh_m[:, :2]
        low, high = map_limits(np.concatenate([before, after, surveyed]))
        size_m = np.linalg.norm(trajectory.residual_coarse_m[:, :2], axis=1)
        factor = magnification(size_m, float((high - low).max()), usual=0.1, most=0.25)
        arrows = [
            arrow_points(surveyed, r[:, :2], factor)
            for r in (trajectory.residual_coarse_m, trajectory.residual_refined_m)
        ]
        low, high = map_limits(np.concatenate([before, after, surveyed, *arrows]))  # no arrow leaves the map
        figure, panels = map_figure(low, high, 2, np.asarray(result.frame.origin_enh_m))
        shown = "arrows true to scale" if factor == 1 else f"arrows × {factor}"
        sides = (
            (panels[0], before, trajectory.residual_coarse_m, COLOUR["coarse"], STAGE_LABEL["coarse"]),
            (panels[1], after, trajectory.residual_refined_m, COLOUR["corrected"], "corrected"),
        )
        places = dict(zip(trajectory.anchors.location, surveyed, strict=True))
        for axes, line, residual_m, colour, title in sides:
            axes.plot(*line.T, color=colour, linewidth=1.2)
            axes.plot(*surveyed.T, marker="^", markersize=5, linestyle="none", color=COLOUR["anchor"], zorder=7)
            draw_errors(axes, surveyed, residual_m[:, :2], factor)
            obstacle = np.concatenate([line[thin(len(line), 800)], arrow_points(surveyed, residual_m[:, :2], factor)])
            label_points(axes, list(places), np.array(list(places.values())), obstacle)
            error_scale(axes, factor, float(np.diff(axes.get_xlim())[0]))
            largest_m = float(np.linalg.norm(residual_m[:, :2], axis=1).max())
            axes.set_title(f"{title}: up to {length_words(largest_m)}, {shown}", loc="left", fontsize=9.5)
        return figure
