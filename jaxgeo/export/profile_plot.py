"""Profile likelihoods, one panel a kind of noise."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from jaxgeo.export.figure_style import COLOUR, WIDTH_IN, figure_style, svg_bytes
from jaxgeo.export.noise_words import COMPONENT, single_axis

COLUMNS = 3
# Half the chi-square quantile of 95 %, one degree of freedom.
DROP_95 = 1.92
_TOP = 5.0
_PANEL_IN = 2.15


def profile_plot(profiles: list[dict[str, Any]]) -> bytes:
    """SVG: the loss of log-likelihood over each sigma, with the prior (solid) and without (dashed).

    Single axes are left out where their group is there. Missing numbers (None) leave gaps.
    """
    with figure_style():
        order = list(COMPONENT)
        shown = [p for p in profiles if not single_axis(p["component"])] or profiles
        shown = sorted(shown, key=lambda p: order.index(p["component"]) if p["component"] in order else len(order))
        rows = -(-len(shown) // COLUMNS)
        height_in = _PANEL_IN * rows + 0.2
        figure = Figure(figsize=(WIDTH_IN, height_in))
        for i, profile in enumerate(shown):
            row, column = divmod(i, COLUMNS)
            left, bottom = 0.07 + column * 0.322, 1.0 - ((row + 1) * _PANEL_IN - 0.52) / height_in
            axes = figure.add_axes((left, bottom, 0.265, (_PANEL_IN - 0.9) / height_in))
            words = COMPONENT.get(profile["component"])
            factor, unit = (words.factor, words.unit) if words else (1.0, "")
            sigma = factor * np.array(profile["sigma"], dtype=float)
            alone, both = (np.array(profile[key], dtype=float) for key in ("drop_likelihood", "drop"))
            axes.plot(sigma, alone, color=COLOUR["coarse"], linestyle="--", linewidth=1.3)
            axes.plot(sigma, both, color=COLOUR["learned"], linewidth=1.6)
            axes.axhline(DROP_95, color="#000000", linestyle=":", linewidth=0.9)
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(numticks=4))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_ylim(0.0, _TOP)
            if column == 0:
                axes.set_ylabel("log-likelihood lost", fontsize=8.5)
            axes.set_xlabel(f"{words.when} [{unit}]" if words else "sigma", fontsize=8.5)
            axes.set_title(words.name if words else profile["component"], loc="left", fontsize=9.0)
        return svg_bytes(figure)
