"""Held-out error of every visit, stage beside stage."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from jaxgeo.export.figure_style import COLOUR, STAGE_LABEL, WIDTH_IN, figure_style, legend_below, length_unit, svg_bytes
from jaxgeo.export.held_out_stats import stats_by_stage
from jaxgeo.export.label_placement import short
from jaxgeo.export.result import TrajectoryResult

# From this ratio of the largest to the smallest on, short bars cannot be read: the axis goes logarithmic, and says so.
LOG_RATIO = 30.0


def held_out_plot(trajectory: TrajectoryResult) -> bytes:
    """SVG: bars of the 3-D error of every visit when its location was left out; a cross where the fold failed."""
    with figure_style():
        stats = stats_by_stage(trajectory)
        label = trajectory.anchors.label
        value = np.array([s.norm_m for s in stats.values()])
        known = value[np.isfinite(value) & (value > 0.0)]
        scale, unit = length_unit(float(np.median(known)) if known.size else 1.0)
        logarithmic = bool(known.size) and known.max() > LOG_RATIO * known.min()
        shown = [short(name) for name in label]
        longest_in = 0.08 * max(map(len, shown))
        upright = longest_in * len(label) > 0.9 * WIDTH_IN  # the names side by side would run into each other
        names_in = 0.2 + (longest_in if upright else 0.1)
        height_in = 3.2 + names_in
        figure = Figure(figsize=(WIDTH_IN, height_in))
        axes = figure.add_axes((0.085, (names_in + 0.45) / height_in, 0.9, 2.4 / height_in))
        floor = 0.5 * scale * float(known.min()) if logarithmic else 0.0
        width = 0.8 / len(stats)
        place = np.arange(len(label))
        for i, stage in enumerate(stats):
            x = place + (i - (len(stats) - 1) / 2.0) * width
            height = np.nan_to_num(scale * value[i] - floor).clip(0.0)
            axes.bar(x, height, 0.92 * width, bottom=floor, color=COLOUR[stage], label=STAGE_LABEL[stage])
            failed = ~np.isfinite(value[i])
            if failed.any():
                style = {"marker": "x", "linestyle": "none", "color": COLOUR[stage], "clip_on": False}
                axes.plot(x[failed], np.full(failed.sum(), floor), **style)
        if logarithmic:
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
            axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylabel(f"Held-out error [{unit}]" + (", log scale" if logarithmic else ""))
        axes.set_xticks(place, shown, rotation=90 if upright else 0)
        axes.set_xlim(-0.6, len(label) - 0.4)
        axes.grid(visible=False, axis="x")
        axes.set_title("Error of every visit's marker when its location was left out", loc="left")
        legend_below(axes, 3, drop=(names_in + 0.05) / 2.4)
        return svg_bytes(figure)
