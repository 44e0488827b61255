"""What a map needs to lie over an orthophoto: the photo, grid coordinates on its frame, a scale bar and north."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from jaxgeo.errors import SurveyError
from jaxgeo.export.map_axes import map_limits
from jaxgeo.export.number_words import grouped
from jaxgeo.georef import LocalFrame, read_crs
from jaxgeo.io.orthophoto import Orthophoto, read_orthophoto

# A map at 9 inches has 1800 pixels at 200 to the inch; more would only make every file larger.
MOST_PX = 1600
PHOTO_OPACITY = 0.8  # over white: lines and labels need a ground that is paler than they are
PALE_OPACITY = 0.5  # under thin lines and see-through ellipses
_FILLED = 1.1  # `map_figure` widens one side so that the axes fill the page


def read_basemap(path: str | Path, frame: LocalFrame, site_en_m: Float[np.ndarray, "n 2"]) -> Orthophoto:
    """The part of an orthophoto that maps of these points show.

    Args:
        site_en_m: local frame: everything that the map will hold.

    Raises:
        SurveyError: the frame is `local` and has no place on a map.
        InputError: as `jaxgeo.io.orthophoto.read_orthophoto`.
    """
    if not frame.has_datum:
        raise SurveyError(f"{path}: crs `local` has no place on a map; give the survey's EPSG code, or no basemap.")
    low, high = map_limits(site_en_m)
    centre, half = (low + high) / 2.0 + np.asarray(frame.origin_enh_m)[:2], _FILLED * float((high - low).max()) / 2.0
    west, south, east, north = (float(x) for x in (*(centre - half), *(centre + half)))
    # The horizontal part alone: what GDAL makes of a compound system whose height grid is missing is a shifted map
    crs = read_crs(frame.crs).horizontal.to_wkt()
    return read_orthophoto(path, crs, (west, south, east, north), MOST_PX)


def draw_basemap(
    axes: Axes, photo: Orthophoto, origin_enh_m: Float[np.ndarray, "3"], opacity: float = PHOTO_OPACITY
) -> None:
    """The orthophoto under everything else, in local coordinates; the limits of the axes stay."""
    west, south, east, north = photo.bounds_en_m
    origin = np.asarray(origin_enh_m)
    extent = (west - origin[0], east - origin[0], south - origin[1], north - origin[1])
    # `none` puts the photo itself into SVG and PDF, not a copy at screen size
    axes.imshow(photo.rgba, extent=extent, aspect="auto", interpolation="none", alpha=opacity, zorder=0)
    axes.grid(color="white", alpha=0.45)
    axes.spines[:].set_visible(True)


def grid_ticks(axes: Axes, origin_enh_m: Float[np.ndarray, "3"], crs: str) -> None:
    """Grid coordinates, written out in full, on the axes of a map in local ones."""
    for axis, limits, origin, name in (
        (axes.xaxis, axes.get_xlim(), float(origin_enh_m[0]), "Easting"),
        (axes.yaxis, axes.get_ylim(), float(origin_enh_m[1]), "Northing"),
    ):
        at = np.array(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]).tick_values(limits[0] + origin, limits[1] + origin))
        at = at[(at >= limits[0] + origin) & (at <= limits[1] + origin)]
        digits = max(0, -int(np.floor(np.log10(np.diff(at).min()) + 1e-9))) if len(at) > 1 else 0
        axis.set_ticks(at - origin, [grouped(float(x), digits) for x in at])
        axis.set_label_text(f"{name} [m], {crs}" if name == "Easting" else f"{name} [m]")
    # Along the frame, as on a survey map: seven digits across would leave no room for the map
    axes.tick_params(axis="y", labelrotation=90)
    for label in axes.get_yticklabels():
        label.set_verticalalignment("center")


def scale_bar(axes: Axes) -> None:
    """A bar of round length in the lower left corner, black and white, on a white plate."""
    low, high = axes.get_xlim()
    length_m = bar_length_m(high - low)
    width = length_m / (high - low)
    text = f"{length_m / 1000.0:g} km" if length_m >= 1000.0 else f"{length_m:g} m"
    frame = {"transform": axes.transAxes, "zorder": 11}
    height_in = axes_size_in(axes)[1]
    line = 0.07 / height_in
    bottom = 0.14 / height_in
    axes.add_patch(
        Rectangle((0.01, 0.05 / height_in), width + 0.03, 0.42 / height_in, color="white", alpha=0.85, **frame)
    )
    for i, colour in enumerate(("#222222", "white", "#222222", "white")):
        place = (0.025 + i * width / 4.0, bottom)
        axes.add_patch(
            Rectangle(place, width / 4.0, line, facecolor=colour, edgecolor="#222222", linewidth=0.8, **frame)
        )
    axes.text(0.025 + width / 2.0, bottom + 0.1 / height_in, text, ha="center", va="bottom", fontsize=9, **frame)


def axes_size_in(axes: Axes) -> tuple[float, float]:
    """Width and height on paper."""
    return axes.bbox.width / axes.figure.dpi, axes.bbox.height / axes.figure.dpi


def bar_length_m(map_width_m: float) -> float:
    """The longest of 1, 2, 5, 10 … metres that takes at most a quarter of the map."""
    return max(
        (b * 10.0**e for e in range(-3, 7) for b in (1, 2, 5) if b * 10.0**e <= 0.25 * map_width_m), default=1e-3
    )


def north_arrow(axes: Axes) -> None:
    """An arrow to grid north in the upper right corner, on a white plate."""
    width_in, height_in = axes_size_in(axes)

    def place(x_in: float, y_in: float) -> tuple[float, float]:
        return 1.0 - x_in / width_in, 1.0 - y_in / height_in

    frame = {"transform": axes.transAxes, "zorder": 11}
    axes.add_patch(Rectangle(place(0.42, 0.68), 0.34 / width_in, 0.62 / height_in, color="white", alpha=0.85, **frame))
    for side, colour in ((-0.09, "#222222"), (0.09, "white")):
        corners = [place(0.25, 0.29), place(0.25 - side, 0.63), place(0.25, 0.55)]
        axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="#222222", linewidth=0.8, **frame))
    axes.text(*place(0.25, 0.28), "N", ha="center", va="bottom", fontsize=10, fontweight="bold", **frame)
