"""Predicted drift of the odometry alone against distance, with what the anchors show of it."""

from matplotlib.figure import Figure

from jaxgeo.export.figure_style import COLOUR, WIDTH_IN, figure_style, legend_below, length_unit, svg_bytes
from jaxgeo.export.result import DriftGrowth


def drift_plot(growth: DriftGrowth) -> bytes:
    """SVG: one sigma of the position by distance from the first anchor, fixed and learned; anchors' misclosures."""
    with figure_style():
        curves = [growth.fixed_m] if growth.learned_m is None else [growth.fixed_m, growth.learned_m]
        # The band of what is barely known may be huge: the curves and the points are what must be read.
        shown = float(max(max(c.max() for c in curves), growth.observed_m.max(initial=0.0)))
        scale, unit = length_unit(shown)
        figure = Figure(figsize=(WIDTH_IN, 3.6))
        axes = figure.add_axes((0.085, 0.25, 0.9, 0.63))
        x = growth.distance_m
        if growth.learned_band_m is not None:
            low, high = scale * growth.learned_band_m
            axes.fill_between(x, low, high, color="#D55E0033", linewidth=0, label="95 % range of what was learned")
        axes.plot(x, scale * growth.fixed_m, color=COLOUR["fixed"], linestyle="--", linewidth=1.4, label="fixed noise")
        if growth.learned_m is not None:
            axes.plot(x, scale * growth.learned_m, color=COLOUR["learned"], linewidth=1.6, label="learned noise")
        seen = growth.observed_distance_m > 0.0
        marker = {"marker": "^", "markersize": 6, "linestyle": "none", "color": COLOUR["anchor"], "zorder": 5}
        axes.plot(
            growth.observed_distance_m[seen], scale * growth.observed_m[seen], label="anchor, missed by", **marker
        )
        axes.set(xlabel="Distance from the first anchor along the path [m]", ylabel=f"Drift [{unit}]")
        axes.set(xlim=(0.0, float(x[-1]) * 1.02 or 1.0), ylim=(0.0, 1.6 * scale * shown or 1.0))
        axes.set_title("Drift of the odometry alone, one sigma, from the first anchor on", loc="left")
        legend_below(axes, 4, drop=0.2)
        return svg_bytes(figure)
