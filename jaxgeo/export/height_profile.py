"""The height of the path against its length, with the heights that the anchors ask for."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jaxgeo.export.figure_style import (
    COLOUR,
    MAX_BAND_VERTICES,
    MAX_LINE_VERTICES,
    STAGE_LABEL,
    WIDTH_IN,
    distance_along_m,
    figure_style,
    grid_label,
    legend_below,
    name_anchors,
    svg_bytes,
    thin,
)
from jaxgeo.export.result import SessionResult, TrajectoryResult


def height_profile(result: SessionResult, trajectory: TrajectoryResult) -> bytes:
    """SVG: height after the one-time similarity and after the correction with its band of two sigma.

    Anchors are drawn at the height that they ask for, so that markers on walls and floors compare with the path.
    """
    with figure_style():
        corrected = trajectory.corrected.position_m
        distance_m = distance_along_m(corrected)
        sigma_m = np.sqrt(trajectory.covariance[:, 2, 2])
        figure = Figure(figsize=(WIDTH_IN, 3.6))
        axes = figure.add_axes((0.085, 0.25, 0.9, 0.6))
        rows, band = thin(len(corrected), MAX_LINE_VERTICES), thin(len(corrected), MAX_BAND_VERTICES)
        coarse = trajectory.coarse_trajectory.position_m[rows, 2]
        axes.plot(distance_m[rows], coarse, color=COLOUR["coarse"], linewidth=0.9, label=STAGE_LABEL["coarse"])
        low, high = corrected[band, 2] - 2.0 * sigma_m[band], corrected[band, 2] + 2.0 * sigma_m[band]
        axes.fill_between(distance_m[band], low, high, color="#0072B233", linewidth=0, label="± 2 sigma")
        axes.plot(distance_m[rows], corrected[rows, 2], color=COLOUR["corrected"], linewidth=1.4, label="corrected")
        pose = trajectory.anchors.pose_index
        marker = {"marker": "^", "markersize": 7, "linestyle": "none", "color": COLOUR["anchor"]}
        axes.plot(distance_m[pose], height_asked_m(trajectory), label="anchor, reduced to the body", zorder=5, **marker)
        axes.set(xlabel="Distance along the corrected path [m]", xlim=(0.0, distance_m[-1]))
        axes.set_ylabel(grid_label("Height", float(result.frame.origin_enh_m[2])))
        name_anchors(axes, distance_m[pose], trajectory.anchors.label)
        axes.set_title("Height of the body along the path", loc="left", pad=18)
        legend_below(axes, 4, drop=0.2)
        return svg_bytes(figure)


def height_asked_m(trajectory: TrajectoryResult) -> Float[np.ndarray, "k"]:
    """The body's height that each anchor alone asks for: surveyed marker less lever arm, at the corrected attitude."""
    return trajectory.corrected.position_m[trajectory.anchors.pose_index, 2] - trajectory.residual_refined_m[:, 2]
