"""The path coloured by its predicted accuracy: rows to draw, and the colours of both maps."""

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.colors import ListedColormap, to_hex

from eval.placement.answer import PlacementAnswer
from eval.placement_report.report import PlacementReport, sigma_along_m
from jaxgeo.export.figure_style import distance_along_m, thin

# Dark blue to green; the yellow end of viridis cannot be seen on white.
_TOP = 0.87
MAX_POINTS = 1500


def colour_map() -> ListedColormap:
    """Dark: accurate."""
    return ListedColormap(colormaps["viridis"](np.linspace(0.0, _TOP, 256)))


def colour_scale() -> list[list]:
    """The same for plotly."""
    share = np.linspace(0.0, 1.0, 11)
    return [[float(s), to_hex(colormaps["viridis"](_TOP * s))] for s in share]


def coloured_path(
    report: PlacementReport, answer: PlacementAnswer
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m 3"], Float[np.ndarray, "m"], Float[np.ndarray, "m 4"]]:
    """Of points along the path, evenly spaced: distance, local position, stamp, sigmas E, N, h and of all axes."""
    way_m = distance_along_m(report.path.position_m)
    even_m = np.linspace(0.0, way_m[-1], MAX_POINTS)
    turns_m = way_m[thin(len(way_m), MAX_POINTS)] if len(way_m) <= MAX_POINTS else way_m[:0]
    at_m = np.union1d(even_m, turns_m)
    position_m = np.column_stack([np.interp(at_m, way_m, axis) for axis in report.path.position_m.T])
    stamp_s = np.interp(at_m, way_m, report.path.stamp_s)
    sigma_m = sigma_along_m(answer, answer.chosen)
    # The answer's way and ours differ by what standing still counts: shares of the way, not metres, are the same.
    share = at_m / way_m[-1]
    along = np.column_stack([np.interp(share, answer.distance_m / answer.distance_m[-1], s) for s in sigma_m.T])
    return at_m, position_m, stamp_s, along
