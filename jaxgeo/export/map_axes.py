"""Axes of a plan view: east right, north up, one scale; and error ellipses on them."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from jaxgeo.export.figure_style import WIDTH_IN, grid_label
from jaxgeo.export.held_out_stats import chi_square_quantile

MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
MARGIN_IN = {"left": 0.75, "right": 0.15, "top": 0.35}
BOTTOM_IN = {1: 0.95, 2: 0.5}  # one panel has its legend below
HEIGHT_LIMITS_IN = (2.6, 7.5)


def map_limits(xy: Float[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner of a map of all these points, with a margin."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    margin = max(0.06 * float((high - low).max()), 0.5)
    return low - margin, high + margin


def map_figure(
    low: np.ndarray, high: np.ndarray, panels: int, origin_enh_m: np.ndarray, more_bottom_in: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """A figure with panels side by side, all with these limits; its height follows the shape of the site.

    `more_bottom_in`: room below for a legend of more than two lines.
    """
    m = MARGIN_IN
    width_in = WIDTH_IN / panels - m["left"] - m["right"]
    span = high - low
    height_in = float(np.clip(width_in * span[1] / span[0], *HEIGHT_LIMITS_IN))
    bottom_in = BOTTOM_IN[panels] + more_bottom_in
    total_in = height_in + bottom_in + m["top"]
    low, high = fill_shape(low, high, width_in / height_in)
    figure = Figure(figsize=(WIDTH_IN, total_in))
    every = []
    for i in range(panels):
        left = (i * WIDTH_IN / panels + m["left"]) / WIDTH_IN
        axes = figure.add_axes((left, bottom_in / total_in, width_in / WIDTH_IN, height_in / total_in))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), autoscale_on=False)
        axes.set_xlabel(grid_label("Easting", origin_enh_m[0]))
        axes.set_ylabel(grid_label("Northing", origin_enh_m[1]) if i == 0 else "")
        axes.locator_params(nbins=8 if panels == 1 else 5)
        every.append(axes)
    return figure, every


def fill_shape(low: np.ndarray, high: np.ndarray, width_over_height: float) -> tuple[np.ndarray, np.ndarray]:
    """Widen the shorter side so that one metre is as long on both axes."""
    centre, span = (low + high) / 2.0, high - low
    span = np.array([max(span[0], span[1] * width_over_height), max(span[1], span[0] / width_over_height)])
    return centre - span / 2.0, centre + span / 2.0


def magnification(size_m: Float[np.ndarray, "k"], map_size_m: float, usual: float, most: float) -> int:
    """A round factor, 1 or more: the median size at most the share `usual` of the map, no size far beyond `most`."""
    size_m = size_m[np.isfinite(size_m) & (size_m > 0.0)]
    if len(size_m) == 0:
        return 1
    wanted = map_size_m * min(usual / float(np.median(size_m)), most / float(np.quantile(size_m, 0.95)))
    return max(f for f in MAGNIFICATIONS if f <= max(wanted, 1.0))


def ellipse_shape(
    covariance_m2: Float[np.ndarray, "k 2 2"], probability: float = 0.95
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Full width and height (m) and angle (degrees, from east) of the error ellipses that hold this probability."""
    eigenvalues, axes = np.linalg.eigh(covariance_m2)
    full = 2.0 * np.sqrt(chi_square_quantile(probability, 2) * np.clip(eigenvalues, 0.0, None))
    return full[:, 1], full[:, 0], np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1]))


def draw_ellipses(axes: Axes, centre: np.ndarray, covariance_m2: np.ndarray, factor: float, **style) -> None:
    """95 % error ellipses at these centres, magnified; rows with NaN are left out."""
    rows = np.isfinite(covariance_m2).all(axis=(1, 2))
    if not rows.any():
        return
    width, height, angle = ellipse_shape(covariance_m2[rows])
    axes.add_collection(
        EllipseCollection(
            factor * width,
            factor * height,
            angle,
            units="xy",
            offsets=centre[rows],
            offset_transform=axes.transData,
            **style,
        )
    )


def error_scale(axes: Axes, factor: float, map_width_m: float) -> None:
    """A bar in the lower left corner: how long a given error is drawn."""
    wanted = 0.12 * map_width_m / factor
    length_m = max((b * 10.0**e for e in range(-4, 4) for b in (1, 2, 5) if b * 10.0**e <= wanted), default=1e-4)
    width = factor * length_m / map_width_m
    scale, unit = (1, "m") if length_m >= 1.0 else (100, "cm") if length_m >= 0.01 else (1000, "mm")
    bar = {"transform": axes.transAxes, "color": "#222222", "linewidth": 2.0, "solid_capstyle": "butt", "zorder": 10}
    axes.plot([0.02, 0.02 + width], [0.03, 0.03], **bar)
    axes.text(
        0.02,
        0.045,
        f"error of {scale * length_m:g} {unit}",
        transform=axes.transAxes,
        fontsize=9,
        va="bottom",
        zorder=10,
    )
