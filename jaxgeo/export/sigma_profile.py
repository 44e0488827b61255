"""The predicted standard deviations along the path: small at the anchors, large between them."""

import numpy as np
from matplotlib.figure import Figure

from jaxgeo.export.figure_style import (
    COLOUR,
    MAX_LINE_VERTICES,
    WIDTH_IN,
    distance_along_m,
    figure_style,
    legend_below,
    length_unit,
    name_anchors,
    svg_bytes,
    thin,
)
from jaxgeo.export.result import TrajectoryResult


def sigma_profile(trajectory: TrajectoryResult) -> bytes:
    """SVG: one sigma of easting, northing and height against the distance along the path; anchors as dotted lines."""
    with figure_style():
        distance_m = distance_along_m(trajectory.corrected.position_m)
        sigma_m = np.sqrt(np.diagonal(trajectory.covariance, axis1=1, axis2=2)[:, :3])
        scale, unit = length_unit(float(sigma_m.max()))
        figure = Figure(figsize=(WIDTH_IN, 3.2))
        axes = figure.add_axes((0.085, 0.28, 0.9, 0.56))
        rows = thin(len(distance_m), MAX_LINE_VERTICES)
        for i, (axis, style) in enumerate({"E": "-", "N": "--", "h": "-."}.items()):
            name = {"E": "easting", "N": "northing", "h": "height"}[axis]
            line = {"color": COLOUR[axis], "linestyle": style, "linewidth": 1.4}
            axes.plot(distance_m[rows], scale * sigma_m[rows, i], label=name, **line)
        axes.plot([], [], color=COLOUR["anchor"], linestyle=":", linewidth=1.0, label="anchor")
        axes.set(xlabel="Distance along the corrected path [m]", ylabel=f"1 sigma [{unit}]")
        axes.set(xlim=(0.0, distance_m[-1]), ylim=(0.0, None))
        name_anchors(axes, distance_m[trajectory.anchors.pose_index], trajectory.anchors.label)
        axes.set_title("Predicted standard deviation of the body's position", loc="left", pad=18)
        legend_below(axes, 4, drop=0.24)
        return svg_bytes(figure)
