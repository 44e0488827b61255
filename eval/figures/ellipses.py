"""Every held-out visit from above: where it was predicted, how sure, and where the surveyor found the marker."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from eval.figures.picture import Picture
from eval.figures.series_style import titled
from jaxgeo.export.figure_style import COLOUR, STAGE_LABEL, WIDTH_IN, figure_style, length_unit
from jaxgeo.export.held_out_stats import STAGES
from jaxgeo.export.label_placement import short
from jaxgeo.export.map_axes import ellipse_shape
from jaxgeo.export.number_words import length_words

COLUMNS = 4
TEXT_COLOUR = {"coarse": "#555555"}  # its grey is too pale for words
MARKER = {"coarse": "s", "fixed": "D", "learned": "o"}
# Errors of the other stages that reach this much farther than the ellipses are shown, farther ones as arrows: one
# visit that a poor stage misses by metres would make all ellipses dots
REACH = 1.6
# A visit that reaches this much farther than the median one is drawn smaller, by a round factor, and says so
OUTLIER = 3.0
SHRINK = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def error_ellipses(
    label: Sequence[str],
    error_en_m: Mapping[str, Float[np.ndarray, "k 2"]],
    covariance_m2: Float[np.ndarray, "k 2 2"],
    stage: str = "learned",
    simulated: bool = False,
) -> Picture:
    """One panel a visit, the surveyed point in the middle; all of one scale, but for outliers, which are marked.

    Args:
        label: of the k visits.
        error_en_m: by stage (`coarse`, `fixed`, `learned`): predicted minus surveyed E, N of the held-out visits; NaN
            where a fold failed.
        covariance_m2: horizontal, of the errors of `stage`; its 50 and 95 % ellipses lie around the predicted point.
        stage: whose ellipses.
    """
    with figure_style():
        error = {s: np.asarray(error_en_m[s], dtype=float) for s in STAGES if s in error_en_m}
        covariance = np.asarray(covariance_m2, dtype=float)
        half_m, shrink = _scales(error, covariance, stage)
        scale, unit = length_unit(half_m)
        columns = min(COLUMNS, len(label))
        rows = -(-len(label) // columns)
        figure, panels = _panels(rows, columns, len(label))
        for j, axes in enumerate(panels):
            axes.set(xlim=(-scale * half_m, scale * half_m), ylim=(-scale * half_m, scale * half_m))
            drawn = scale / shrink[j]
            _ellipses(axes, error[stage][j], covariance[j], drawn, COLOUR[stage])
            axes.plot(0.0, 0.0, marker="+", markersize=13, markeredgewidth=1.6, color=COLOUR["anchor"], zorder=5)
            far = [words for s, e in error.items() for words in _point(axes, e[j], s, half_m * shrink[j], drawn)]
            _write_far(axes, far)
            axes.set_title(short(label[j]), loc="left", fontweight="bold")
            if shrink[j] > 1:
                axes.set_title(f"drawn 1 : {shrink[j]}", loc="right", fontsize=9.5)
                axes.set_facecolor("#f4efdf")
            axes.set(xticks=ticks(scale * half_m), yticks=ticks(scale * half_m))
            if j % columns == 0:
                axes.set_ylabel(f"North [{unit}]")
            if j + columns >= len(label):
                axes.set_xlabel(f"East [{unit}]")
                axes.tick_params(labelbottom=True)
        title = titled("Predicted minus surveyed marker position when its location was left out", simulated)
        height_in = figure.get_figheight()
        figure.suptitle(
            title, x=0.7 / figure.get_figwidth(), y=1.0 - 0.08 / height_in, ha="left", va="top", fontsize=11
        )
        _legend(figure, list(error), stage)
        return Picture(figure)


def ticks(half: float) -> Float[np.ndarray, "_"]:
    """Round values around zero, none so near the corner that it would run into the next panel's."""
    step = max(b * 10.0**e for e in range(-6, 9) for b in (1, 2, 5) if b * 10.0**e <= 0.55 * half)
    count = int(0.8 * half / step)
    return step * np.arange(-count, count + 1)


def _scales(error: Mapping[str, np.ndarray], covariance: np.ndarray, stage: str) -> tuple[float, list[int]]:
    """Half the side of a panel, and by how much each visit is drawn smaller: 1, but for those far larger than most."""
    known = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(error[stage]).all(axis=1)
    reach = np.zeros(len(covariance))
    if not known.any():
        return 1.0, [1] * len(reach)
    reach[known] = np.linalg.norm(error[stage][known], axis=1) + ellipse_shape(covariance[known])[0] / 2.0
    usual = reach <= OUTLIER * np.median(reach[known])
    largest = float(reach[usual].max())
    others = np.concatenate([np.abs(e).max(axis=1)[usual] for e in error.values()])
    near = others[np.isfinite(others) & (others <= REACH * largest)]
    half_m = 1.06 * max(largest, float(near.max(initial=0.0))) or 1.0
    return half_m, [next(f for f in SHRINK if f * half_m >= x or f == SHRINK[-1]) for x in reach]


def _panels(rows: int, columns: int, count: int) -> tuple[Figure, list[Axes]]:
    """Square panels in rows."""
    side_in = (WIDTH_IN - 0.85) / COLUMNS - 0.18
    width_in = 0.85 + columns * (side_in + 0.18)
    width_in = max(width_in, 6.5)  # the legend needs it
    height_in = 0.4 + rows * (side_in + 0.32) + 0.95
    figure = Figure(figsize=(width_in, height_in))
    panels = []
    for j in range(count):
        row, column = divmod(j, columns)
        left = 0.7 + column * (side_in + 0.18)
        bottom = height_in - 0.4 - (row + 1) * (side_in + 0.32)
        box = (left / width_in, bottom / height_in, side_in / width_in, side_in / height_in)
        axes = figure.add_axes(box)
        axes.tick_params(labelleft=column == 0, labelbottom=False)
        panels.append(axes)
    return figure, panels


def _ellipses(axes: Axes, centre_m: np.ndarray, covariance_m2: np.ndarray, scale: float, colour: str) -> None:
    if not (np.isfinite(covariance_m2).all() and np.isfinite(centre_m).all()):
        axes.text(0.5, 0.9, "no prediction", transform=axes.transAxes, ha="center", va="top", fontsize=9)
        return
    for probability, opacity, dash in ((0.95, 0.10, (0, (4, 2))), (0.5, 0.22, "-")):
        width, height, angle = ellipse_shape(covariance_m2[None], probability)
        style = {"units": "xy", "offset_transform": axes.transData, "zorder": 3, "linewidths": 1.1}
        axes.add_collection(
            EllipseCollection(
                scale * width,
                scale * height,
                angle,
                offsets=scale * centre_m[None],
                facecolors=(colour, opacity),
                edgecolors=colour,
                linestyles=[dash],
                **style,
            )
        )


def _point(axes: Axes, error_m: np.ndarray, stage: str, half_m: float, scale: float) -> list[tuple[str, str]]:
    """The stage's point; where it lies outside the panel an arrow towards it, and its distance in words."""
    if not np.isfinite(error_m).all():
        return []
    if np.abs(error_m).max() <= half_m:
        style = {"markersize": 7, "markeredgecolor": "white", "markeredgewidth": 0.7, "zorder": 6}
        axes.plot(*(scale * error_m), marker=MARKER[stage], color=COLOUR[stage], **style)
        return []
    tip = 0.97 * scale * half_m * error_m / np.abs(error_m).max()
    arrow = {"arrowstyle": "-|>", "color": COLOUR[stage], "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(tip), xytext=tuple(0.78 * tip), arrowprops=arrow, zorder=6)
    return [(stage, length_words(float(np.linalg.norm(error_m))))]


def _write_far(axes: Axes, far: list[tuple[str, str]]) -> None:
    """The distances of points outside the panel, in its lower left corner, in the colours of their stages."""
    for i, (stage, words) in enumerate(far):
        plate = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
        style = {"transform": axes.transAxes, "fontsize": 9, "va": "bottom", "zorder": 8, "bbox": plate}
        axes.text(0.03, 0.03 + 0.1 * i, words, color=TEXT_COLOUR.get(stage, COLOUR[stage]), **style)


def _legend(figure: Figure, stages: list[str], stage: str) -> None:
    key = {"linestyle": "none", "markersize": 8}
    keys = [Line2D([], [], marker="+", markeredgewidth=1.6, color=COLOUR["anchor"], label="surveyed point", **key)]
    keys += [Line2D([], [], marker=MARKER[s], color=COLOUR[s], label=STAGE_LABEL[s], **key) for s in stages]
    keys += [
        Line2D([], [], color=COLOUR[stage], linewidth=1.1, label="holds 50 %"),
        Line2D([], [], color=COLOUR[stage], linewidth=1.1, linestyle=(0, (4, 2)), label="holds 95 %"),
    ]
    figure.legend(handles=keys, loc="lower center", ncol=3, columnspacing=1.6)
