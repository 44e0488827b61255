"""Where one session's cloud lies away from another's: a plan view of median distances, and their distribution."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from eval.cloud_comparison import DistanceMap
from eval.figures.picture import Picture
from eval.figures.series_style import titled
from jaxgeo.export.figure_style import COLOUR, WIDTH_IN, figure_style, grid_label
from jaxgeo.export.map_axes import fill_shape

# Steps that a surveyor thinks in, metres
STEPS_M = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
MET_M = 0.30
MOST_TICKS = 6


def distance_map_figure(
    found: DistanceMap, first: str, second: str, origin_enh_m: Float[np.ndarray, "3"], simulated: bool = False
) -> Picture:
    """A plan view, east right, north up: the median distance from the first cloud to the second in every cell."""
    rows, columns = found.median_m.shape
    high = found.low_m + found.cell_m * np.array([columns, rows])
    width_in = WIDTH_IN - 2.2
    height_in = float(np.clip(width_in * rows / columns, 3.0, 8.0))
    low_m, high_m = fill_shape(found.low_m, high, width_in / height_in)
    with figure_style():
        total_in = height_in + 1.0
        figure = Figure(figsize=(WIDTH_IN, total_in))
        axes = figure.add_axes((0.85 / WIDTH_IN, 0.55 / total_in, width_in / WIDTH_IN, height_in / total_in))
        bar = figure.add_axes(((1.05 + width_in) / WIDTH_IN, 0.55 / total_in, 0.18 / WIDTH_IN, height_in / total_in))
        norm = BoundaryNorm(np.array(STEPS_M), 256, extend="max")
        x = found.low_m[0] + found.cell_m * np.arange(columns + 1)
        y = found.low_m[1] + found.cell_m * np.arange(rows + 1)
        image = axes.pcolormesh(x, y, found.median_m, cmap="viridis", norm=norm, rasterized=True)
        axes.set(xlim=(low_m[0], high_m[0]), ylim=(low_m[1], high_m[1]), autoscale_on=False)
        axes.set_xlabel(grid_label("Easting", origin_enh_m[0]))
        axes.set_ylabel(grid_label("Northing", origin_enh_m[1]))
        axes.locator_params(nbins=MOST_TICKS)
        drawn = figure.colorbar(image, cax=bar, ticks=STEPS_M)
        drawn.set_label(f"median distance in a cell of {found.cell_m:g} m [m]")
        drawn.ax.set_yticklabels([f"{s:g}" for s in STEPS_M])
        axes.set_title(titled(f"From {first} to the nearest point of {second}", simulated), loc="left", pad=8)
        return Picture(figure)


def distance_histogram_figure(distances_m: dict[str, Float[np.ndarray, "_"]], simulated: bool = False) -> Picture:
    """Share of points by distance, both ways, on a logarithmic axis; the cumulative share over it."""
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 3.6))
        axes = figure.add_axes((0.09, 0.16, 0.40, 0.72))
        below = figure.add_axes((0.58, 0.16, 0.40, 0.72))
        edges = np.geomspace(1e-3, 100.0, 76)
        for (name, distance), colour in zip(distances_m.items(), (COLOUR["fixed"], COLOUR["learned"]), strict=False):
            share = np.histogram(np.clip(distance, edges[0], edges[-1]), edges)[0] / len(distance)
            axes.stairs(100.0 * share, edges, color=colour, linewidth=1.4, label=name)
            below.plot(edges[1:], 100.0 * np.cumsum(share), color=colour, linewidth=1.6, label=name)
        for each in (axes, below):
            _distance_axis(each, max(float(d.max()) for d in distances_m.values()))
        axes.set_ylabel("points in a class [%]")
        below.set_ylabel("points nearer than this [%]")
        below.set_ylim(0.0, 100.0)
        axes.legend(loc="upper left")
        axes.set_title(titled("Distances between the clouds", simulated), loc="left", pad=8)
        return Picture(figure)


def _distance_axis(axes: Axes, most_m: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(1e-3, float(np.clip(2.0 * most_m, 1.0, 100.0)))
    axes.axvline(MET_M, color="#222222", linewidth=1.0, linestyle=":")
    ticks = [t for t in (0.001, 0.01, 0.1, 0.3, 1.0, 10.0, 100.0) if t <= axes.get_xlim()[1]]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set_xlabel("distance to the nearest point [m]")
