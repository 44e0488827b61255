"""The picture of a map's loops: the path before and after in plan, with the closures; heights along the path."""

from io import BytesIO

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxgeo.export.figure_style import COLOUR, MAX_LINE_VERTICES, WIDTH_IN, distance_along_m, figure_style, thin

_MOST_CLOSURES = 2_000


def loops_png(
    before_m: Float[np.ndarray, "n 3"],
    after_m: Float[np.ndarray, "n 3"],
    keyframe_before_m: Float[np.ndarray, "k 3"],
    keyframe_after_m: Float[np.ndarray, "k 3"],
    pairs: Int[np.ndarray, "c 2"],
    accepted: Bool[np.ndarray, "c"],
) -> bytes:
    """PNG: plans before and after side by side, and heights; accepted closures green, rejected ones orange."""
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 0.85 * WIDTH_IN), layout="constrained")
        grid = figure.add_gridspec(2, 2, height_ratios=(2.2, 1.0))
        left = figure.add_subplot(grid[0, 0])
        right = figure.add_subplot(grid[0, 1], sharex=left, sharey=left)
        _plan(left, before_m, keyframe_before_m, pairs, accepted, COLOUR["coarse"])
        _plan(right, after_m, keyframe_after_m, pairs, accepted, COLOUR["corrected"])
        left.set_title("as given")
        right.set_title(f"loops closed: {int(accepted.sum())} of {len(accepted)} closures accepted")
        left.set_ylabel("y [m]")
        handles, labels = right.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        _heights(figure.add_subplot(grid[1, :]), before_m, after_m)
        buffer = BytesIO()
        figure.set_dpi(150)
        FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
        return buffer.getvalue()


def _plan(
    axes: Axes,
    path_m: Float[np.ndarray, "n 3"],
    keyframe_m: Float[np.ndarray, "k 3"],
    pairs: Int[np.ndarray, "c 2"],
    accepted: Bool[np.ndarray, "c"],
    colour: str,
) -> None:
    rows = thin(len(path_m), MAX_LINE_VERTICES)
    axes.plot(*path_m[rows, :2].T, color=colour, linewidth=1.2)
    for chosen, ink, label in ((accepted, COLOUR["h"], "accepted closure"), (~accepted, COLOUR["error"], "rejected")):
        of_these = pairs[chosen]
        for first, second in of_these[thin(len(of_these), _MOST_CLOSURES)] if len(of_these) else ():
            axes.plot(
                *keyframe_m[[first, second], :2].T, color=ink, linewidth=0.7, marker="o", markersize=2, label=label
            )
            label = "_"
    axes.plot(*path_m[0, :2], "^", markersize=6, markerfacecolor="white", markeredgecolor="black", label="start")
    axes.plot(*path_m[-1, :2], "s", markersize=6, markerfacecolor="white", markeredgecolor="black", label="end")
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")


def _heights(axes: Axes, before_m: Float[np.ndarray, "n 3"], after_m: Float[np.ndarray, "n 3"]) -> None:
    rows = thin(len(after_m), MAX_LINE_VERTICES)
    along_m = distance_along_m(after_m)[rows]
    axes.plot(along_m, before_m[rows, 2], color=COLOUR["coarse"], linewidth=1.0, label="as given")
    axes.plot(along_m, after_m[rows, 2], color=COLOUR["corrected"], linewidth=1.2, label="loops closed")
    axes.set_xlabel("path [m]")
    axes.set_ylabel("z [m]")
    axes.legend(loc="best")
