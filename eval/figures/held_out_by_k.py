"""How accuracy falls with fewer anchors: held-out and in-sample error against their number."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from eval.figures.picture import Picture
from eval.figures.series_style import titled
from jaxgeo.export.figure_style import COLOUR, WIDTH_IN, figure_style, length_unit

# From this ratio of the largest to the smallest value on, the axis is logarithmic: else the small ones cannot be read
LOG_RATIO = 20.0
MOST_COLUMNS = 2
HELD_OUT, IN_SAMPLE = COLOUR["learned"], COLOUR["fixed"]


class ByNumber(NamedTuple):
    """Errors of one trajectory by the number of anchors; NaN where there is none.

    Attributes:
        ks: (m,) number of anchors.
        held_out_mean_m, held_out_rms_m, in_sample_mean_m: (m,) over all choices of that many anchors.
    """

    ks: Int[np.ndarray, "m"]
    held_out_mean_m: Float[np.ndarray, "m"]
    held_out_rms_m: Float[np.ndarray, "m"]
    in_sample_mean_m: Float[np.ndarray, "m"]


def held_out_by_k(
    series: Mapping[str, ByNumber | tuple],
    reference: Mapping[str, ByNumber | tuple] | None = None,
    reference_label: str = "reference study, other data",
    simulated: bool = False,
) -> Picture:
    """One panel a trajectory, one scale for all; means as markers, the bar above each ends at the RMS.

    Args:
        series: by the panel's title; a plain tuple in the order of `ByNumber` will do.
        reference: other results to be drawn beside, hollow, by the title of their panel.
        reference_label: whose.
    """
    with figure_style():
        ours = {name: _arrays(s) for name, s in series.items()}
        theirs = {name: _arrays(s) for name, s in (reference or {}).items() if name in ours}
        value = np.concatenate([np.concatenate(s[1:]) for s in (*ours.values(), *theirs.values())])
        known = value[np.isfinite(value) & (value > 0.0)]
        logarithmic = bool(known.size) and known.max() > LOG_RATIO * known.min()
        scale, unit = length_unit(float(np.median(known)) if known.size else 1.0)
        columns = min(MOST_COLUMNS, len(ours))
        rows = -(-len(ours) // columns)
        below_in = 0.98 if theirs else 0.8
        height_in = 2.6 * rows + below_in
        figure = Figure(figsize=(WIDTH_IN * (1.0 if columns > 1 else 0.6), height_in))
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        figure.subplots_adjust(
            left=0.8 / figure.get_figwidth(),
            right=0.985,
            top=1.0 - 0.62 / height_in,
            bottom=below_in / height_in,
            wspace=0.06,
            hspace=0.2,
        )
        for axes, (name, s) in zip(panels.flat, ours.items(), strict=False):
            _draw(axes, s, scale, -0.05 if name in theirs else 0.0, hollow=False)
            if name in theirs:
                _draw(axes, theirs[name], scale, 0.05, hollow=True)
            axes.set_title(name, loc="left")
        for axes in panels.flat[len(ours) :]:
            axes.remove()
        ks = np.unique(np.concatenate([s.ks for s in (*ours.values(), *theirs.values())]))
        first = panels[0, 0]
        first.set_xticks(ks)
        first.set_xlim(ks.min() - 0.4, ks.max() + 0.4)
        if logarithmic:
            first.set_yscale("log")
            first.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            first.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
            first.yaxis.set_minor_formatter(NullFormatter())
        else:
            first.set_ylim(0.0, 1.06 * scale * float(known.max(initial=0.0)) or 1.0)
        for axes in panels[:, 0]:
            axes.set_ylabel(f"Error [{unit}]" + (", log scale" if logarithmic else ""))
        for i in range(columns):
            lowest = max(r for r in range(rows) if r * columns + i < len(ours))
            panels[lowest, i].set_xlabel("Number of anchors k")
            panels[lowest, i].tick_params(labelbottom=True)
        figure.suptitle(
            titled("Error by number of anchors; bars end at the RMS", simulated),
            x=0.8 / figure.get_figwidth(),
            y=1.0 - 0.1 / height_in,
            ha="left",
            va="top",
            fontsize=11,
        )
        _legend(figure, bool(theirs), reference_label)
        return Picture(figure)


def _arrays(series: ByNumber | tuple) -> ByNumber:
    ks, *errors = (np.asarray(x) for x in series)
    order = np.argsort(ks)
    return ByNumber(ks[order], *(x[order].astype(float) for x in errors))


def _draw(axes: Axes, s: ByNumber, scale: float, shift: float, hollow: bool) -> None:
    x = s.ks + shift
    for value, colour, marker, dash in (
        (s.held_out_mean_m, HELD_OUT, "o", "-"),
        (s.in_sample_mean_m, IN_SAMPLE, "s", (0, (5, 2))),
    ):
        style = {"color": colour, "marker": marker, "markersize": 7, "linewidth": 0.8 if hollow else 1.5}
        face = "white" if hollow else colour
        line = (0, (1, 2)) if hollow else dash
        axes.plot(x, scale * value, linestyle=line, markerfacecolor=face, zorder=3 + (not hollow), **style)
    whisker = scale * (s.held_out_rms_m - s.held_out_mean_m)
    rows = np.isfinite(whisker)
    if rows.any():
        none = np.zeros(rows.sum())
        axes.errorbar(
            x[rows],
            scale * s.held_out_mean_m[rows],
            yerr=[none, whisker[rows].clip(0.0)],
            fmt="none",
            ecolor=HELD_OUT,
            elinewidth=1.0,
            capsize=3.5,
            zorder=2,
        )


def _legend(figure: Figure, with_reference: bool, reference_label: str) -> None:
    def key(colour: str, marker: str, dash: Any, hollow: bool, label: str) -> Line2D:
        style = {"markersize": 7, "linewidth": 0.8 if hollow else 1.5, "markerfacecolor": "white" if hollow else colour}
        return Line2D([], [], color=colour, marker=marker, linestyle=dash, label=label, **style)

    keys = [
        key(HELD_OUT, "o", "-", False, "held out, mean"),
        key(IN_SAMPLE, "s", (0, (5, 2)), False, "in sample, mean"),
    ]
    if with_reference:
        dots = (0, (1, 2))
        keys.insert(1, key(HELD_OUT, "o", dots, True, f"held out ({reference_label})"))
        keys.append(key(IN_SAMPLE, "s", dots, True, f"in sample ({reference_label})"))
    figure.legend(handles=keys, loc="lower center", ncol=2, columnspacing=1.6, handlelength=2.6)
