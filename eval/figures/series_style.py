"""How the lines of several trajectories differ: by colour for most readers, by dash and marker for all."""

from typing import Any

# Okabe and Ito's palette, dark colours first
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.6)), (0, (6, 1.6, 1.4, 1.6)), (0, (1.6, 1.2)), (0, (9, 2)), "-")
MARKERS = ("o", "s", "^", "D", "v", "P")


def series_line(i: int) -> dict[str, Any]:
    """Colour and dash of the i-th line; they repeat after six."""
    return {"color": COLOURS[i % 6], "linestyle": DASHES[i % 6]}


def series_marker(i: int) -> dict[str, Any]:
    """Colour and marker of the i-th set of points."""
    return {"color": COLOURS[i % 6], "marker": MARKERS[i % 6], "linestyle": "none"}


def titled(title: str, simulated: bool) -> str:
    """The title; that the data were simulated stands in the picture itself, wherever it is shown."""
    return f"{title} (simulated data)" if simulated else title
