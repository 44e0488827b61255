"""How near the learned noise comes to the true one, over many simulated sessions of each regime."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from eval.figures.picture import Picture
from eval.figures.series_style import titled
from jaxgeo.export.figure_style import COLOUR, WIDTH_IN, figure_style

FOLD = 1.5  # the band within which a noise counts as found
WHISKERS = (5.0, 95.0)  # percent
MOST_DOTS = 400


def calibration_ratio(
    ratio: Mapping[str, Float[np.ndarray, "_"]],
    quantity: str = "Learned sigma over true sigma",
    simulated: bool = True,
) -> Picture:
    """One row a regime: median and quartiles as a box, whiskers to 5 and 95 %, every session a dot; logarithmic.

    Args:
        ratio: by regime: learned over true value, one a session; what is not finite and positive is left out and not
            counted in n.
        quantity: of what, for the axis.
    """
    with figure_style():
        known = {name: _known(values) for name, values in ratio.items()}
        names_in = 0.3 + 0.075 * max(
            (len(line) for name in known for line in _row_label(name, 0).split("\n")), default=1
        )
        height_in = 0.5 * len(known) + 1.25
        figure = Figure(figsize=(WIDTH_IN, height_in))
        left = names_in / WIDTH_IN
        axes = figure.add_axes((left, 0.75 / height_in, 0.87 - left, 0.5 * len(known) / height_in))
        axes.set_xscale("log")
        axes.axvspan(1.0 / FOLD, FOLD, color=COLOUR["h"], alpha=0.15, linewidth=0)
        axes.axvline(1.0, color="#222222", linewidth=1.0)
        for i, values in enumerate(known.values()):
            _row(axes, values, i)
        axes.set_yticks(range(len(known)), [_row_label(name, len(values)) for name, values in known.items()])
        axes.set_ylim(len(known) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        every = np.concatenate([np.zeros(0), *known.values()])
        if every.size:
            low, high = min(1.0 / FOLD, float(every.min())), max(FOLD, float(every.max()))
            axes.set_xlim(low / 1.12, high * 1.12)
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(f"{quantity}, log scale; shaded: within {FOLD:g}-fold")
        within = f"within\n{FOLD:g}-fold"
        axes.text(1.01, 1.0, within, transform=axes.transAxes, fontsize=9, va="bottom", linespacing=1.0)
        axes.set_title(titled("Learned against true noise", simulated), loc="left", pad=10)
        return Picture(figure)


def share_within(values: Float[np.ndarray, "n"], fold: float = FOLD) -> float:
    """Share of the values from 1/fold to fold; NaN of none."""
    return float(np.mean(np.abs(np.log(values)) <= np.log(fold))) if len(values) else float("nan")


def _row(axes, values: Float[np.ndarray, "n"], i: int) -> None:
    if not len(values):
        axes.text(1.0, i, "none", ha="center", va="center", fontsize=9)
        return
    dots = np.sort(values)[np.unique(np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).round().astype(int))]
    # Spread by the golden ratio: even, and the same every time
    height = i + 0.56 * ((np.arange(len(dots)) * 0.6180339887498949) % 1.0 - 0.5)
    axes.plot(dots, height, marker=".", markersize=3, linestyle="none", color=COLOUR["fixed"], alpha=0.35, zorder=2)
    box = {
        "med": float(np.median(values)),
        "q1": float(np.percentile(values, 25.0)),
        "q3": float(np.percentile(values, 75.0)),
        "whislo": float(np.percentile(values, WHISKERS[0])),
        "whishi": float(np.percentile(values, WHISKERS[1])),
    }
    axes.bxp(
        [box],
        positions=[i],
        widths=0.42,
        orientation="horizontal",
        showfliers=False,
        manage_ticks=False,
        patch_artist=True,
        boxprops={"facecolor": (1.0, 1.0, 1.0, 0.65), "edgecolor": COLOUR["fixed"], "linewidth": 1.3},
        whiskerprops={"color": COLOUR["fixed"], "linewidth": 1.3},
        capprops={"color": COLOUR["fixed"], "linewidth": 1.3},
        medianprops={"color": COLOUR["learned"], "linewidth": 2.2},
        zorder=3,
    )
    axes.text(
        1.01, i, f"{100.0 * share_within(values):.0f} %", transform=axes.get_yaxis_transform(), va="center", fontsize=9
    )


def _row_label(name: str, n: int) -> str:
    return f"{name}\nn = {n}"


def _known(values: np.ndarray) -> Float[np.ndarray, "n"]:
    values = np.asarray(values, dtype=float).ravel()
    return values[np.isfinite(values) & (values > 0.0)]
