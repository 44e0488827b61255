"""Figures that answer the pointer, offline: numbers as JSON in the page, drawn by plotly.js, which the page holds once.

A browser with JavaScript shows the interactive figure; without, and on paper, the static one in its place is seen.

The JSON of a figure, read by interactive.js:

    columns   {name: numbers}, shared by the traces
    data      plotly traces; beside plotly's own keys a trace may have
              columns {attribute: column name, or {axis: column name}}, hover [column names] (customdata in that order),
              magnified {x, y, dx, dy}: drawn at x + factor dx
    layout    plotly's
    aspect    height over width of a map; or height_px of anything else
    magnify   {label, factors, start}: a slider for the factor
    axes      {axis: {name, title, range, head}}: buttons that change the x axis; head of the hover box
    lines     {at: {axis: column name}, text}: dotted lines across the figure at these x, with their names above
    linked    index of the trace whose rows are pointed at in the other figures of the group
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxgeo.export.report_page import escape

FONT = {"family": 'system-ui, "Segoe UI", "DejaVu Sans", Arial, sans-serif', "size": 12.5, "color": "#1a1a1a"}
GRID = {"gridcolor": "#dddddd", "linecolor": "#666666", "zeroline": False, "showline": True, "ticks": "outside"}
# More points of a path than this cannot be told apart on a screen, and make the page heavy.
MAX_POINTS = 2500
# Decimal point, thin spaces between thousands: what plotly's formats with a comma put in.
SEPARATORS = ".\u202f"


def interactive_scripts() -> tuple[str, str]:
    """plotly.js and the code that draws our figures, for `report_page.page(.., scripts=..)`."""
    from plotly.offline import get_plotlyjs

    own = Path(__file__).with_suffix(".js").read_text(encoding="utf-8")
    return get_plotlyjs(), own


def interactive_figure(spec: Mapping[str, Any], label: str, caption: str, *, static: str = "", group: str = "") -> str:
    """One figure, drawn in the browser from `spec`; the page needs `interactive_scripts`.

    Args:
        spec: what to draw, see above; NumPy arrays, with NaN for gaps, are welcome.
        label: what a screen reader says of the figure.
        caption: under the figure, plain text.
        static: HTML, seen instead where there is no JavaScript, and on paper.
        group: figures of one group point at the same pose.
    """
    return (
        f'<div class="either"><div class="static">{static}</div><figure class="interactive" role="group" '
        f'aria-label="{escape(label)}" data-group="{escape(group)}">'
        f'<script type="application/json">{json_block(spec)}</script>'
        f"<figcaption>{escape(caption)}</figcaption></figure></div>"
    )


def json_block(value: Any) -> str:
    """JSON that cannot end the script element it stands in; NaN becomes null."""
    text = json.dumps(plain(value), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def plain(value: Any) -> Any:
    """Arrays to lists, NaN and infinities to None, at any depth."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f":
            return [x if math.isfinite(x) else None for x in value.tolist()]
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def plot_text(text: object) -> str:
    """A user's text in labels, legends and hover boxes, where plotly reads a few HTML tags."""
    return escape(text)


def layout(**parts: Any) -> dict[str, Any]:
    """What all figures share: type, colours, the legend below."""
    legend = {"orientation": "h", "x": 0, "xanchor": "left", "y": 0, "yref": "container", "yanchor": "bottom"}
    return {
        "font": FONT,
        "separators": SEPARATORS,
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "margin": {"l": 72, "r": 14, "t": 30, "b": 50},
        "legend": legend | {"font": {"size": 12}},
        "hoverlabel": {"bgcolor": "#ffffff", "align": "left", "font": FONT},
        **parts,
    }


def metre_axis(title: str, **parts: Any) -> dict[str, Any]:
    """An axis in whole metres that shows decimals where one has zoomed in; never an exponent or an offset."""
    stops = [((None, 0.001), ",.4f"), ((0.001, 0.01), ",.3f"), ((0.01, 0.1), ",.2f"), ((0.1, 0.9), ",.1f")]
    formats = [{"dtickrange": list(ends), "value": value} for ends, value in stops]
    return {**GRID, "title": {"text": title}, "tickformat": ",.0f", "tickformatstops": formats, **parts}
