"""What all figures share: colours that colour-blind readers tell apart, type sizes, and the way to SVG."""

import contextlib
import io
from collections.abc import Iterator
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

# Okabe and Ito's palette, the colour of one thing in every figure
COLOUR = {
    "coarse": "#8c8c8c",
    "fixed": "#0072B2",
    "learned": "#D55E00",
    "corrected": "#0072B2",
    "anchor": "#000000",
    "unused": "#8c8c8c",
    "error": "#D55E00",
    "E": "#0072B2",
    "N": "#D55E00",
    "h": "#009E73",
}
STAGE_LABEL = {
    "coarse": "one-time similarity",
    "fixed": "corrected, fixed noise",
    "learned": "corrected, learned noise",
}
WIDTH_IN = 9.0
# More vertices than this cannot be seen in one figure; a band's outline is not simplified by matplotlib.
MAX_LINE_VERTICES = 20_000
MAX_BAND_VERTICES = 1_000
RC: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.labelsize": 9.5,
    "legend.fontsize": 9.0,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#666666",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "text.parse_math": False,  # a dollar sign in a location's name is a dollar sign
    "svg.fonttype": "none",
    "svg.hashsalt": "jaxgeo",  # the same figure gives the same bytes
    "path.simplify": True,
    "path.simplify_threshold": 0.25,
}


@contextlib.contextmanager
def figure_style() -> Iterator[None]:
    """Our settings, whatever the user's matplotlibrc says, for making and for drawing a figure."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC)
        yield


def svg_bytes(figure: Figure) -> bytes:
    """The figure as SVG; call it inside `figure_style`."""
    buffer = io.BytesIO()
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    return buffer.getvalue()


def thin(n: int, most: int) -> Int[np.ndarray, "m"]:
    """At most about `most` of n rows, evenly spaced, first and last kept."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))


def distance_along_m(position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Length of the path from its start to every pose."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position_m, axis=0), axis=1))])


def length_unit(largest_m: float) -> tuple[float, str]:
    """Units in one metre and the unit's name, so that values up to `largest_m` read easily."""
    if not np.isfinite(largest_m) or largest_m >= 3.0:
        return 1.0, "m"
    return (100.0, "cm") if largest_m >= 0.03 else (1000.0, "mm")


def grid_label(axis: str, origin_m: float) -> str:
    """Axis label of a local coordinate: what was taken off the grid value stands in it."""
    if origin_m == 0.0:
        return f"{axis} [m]"
    sign = "−" if origin_m > 0.0 else "+"
    return f"{axis} {sign} {abs(origin_m):,.0f} [m]".replace(",", "\u202f")


def name_anchors(axes: Axes, distance_m: Float[np.ndarray, "k"], label: tuple[str, ...]) -> None:
    """Dotted lines at the anchors, their names above the frame; a name that would run into the last is left out."""
    low, high = axes.get_xlim()
    width_pt = 72.0 * WIDTH_IN * axes.get_position().width
    free = -np.inf
    for x, name in sorted(zip(distance_m.tolist(), label, strict=True)):
        axes.axvline(x, color=COLOUR["anchor"], linestyle=":", linewidth=0.8)
        half = 0.31 * RC["font.size"] * len(name) / width_pt
        centre = min((x - low) / (high - low), 1.0 - half)  # the last name stays inside the figure
        if centre - half > free:
            axes.text(centre, 1.015, name, transform=axes.transAxes, ha="center", va="bottom", fontsize=9)
            free = centre + half + 4.0 / width_pt


def legend_below(axes: Axes, columns: int, drop: float = 0.13) -> None:
    """The legend under the axes, where it hides nothing; `drop` in parts of the axes' height."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -drop), ncol=columns, handlelength=2.2, columnspacing=1.6)
