"""The map of planned anchors on paper: the path by its predicted accuracy, ellipses, anchors by name."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from eval.figures.picture import Picture
from eval.figures.series_style import titled
from eval.placement.answer import PlacementAnswer
from eval.placement_report.map_spec import EVEN, PLANNED, STANDING, ellipse_factor, place_on_path
from eval.placement_report.path_colour import colour_map, coloured_path
from eval.placement_report.report import PlacementReport, count_of, layout_by, visits_by_anchor
from jaxgeo.export.basemap import PALE_OPACITY, draw_basemap, grid_ticks, north_arrow, scale_bar
from jaxgeo.export.figure_style import COLOUR, figure_style, length_unit, thin
from jaxgeo.export.label_placement import label_points
from jaxgeo.export.map_axes import draw_ellipses, map_figure, map_limits
from jaxgeo.export.plan_view import PATH_ELLIPSES, draw_ends, evenly_spaced_rows

# Below the map: the legend's second row and the colour bar.
_BELOW_IN = 0.85
_BAR_SHARE = 0.05


def placement_map(report: PlacementReport, answer: PlacementAnswer) -> Picture:
    """Grid coordinates on the axes, north up; ellipses hold 95 % and are magnified as the title says."""
    with figure_style():
        chosen, origin = answer.chosen, np.asarray(report.frame.origin_enh_m)
        _, path_m, _, sigma_m = coloured_path(report, answer)
        low, high = map_limits(np.concatenate([path_m[:, :2], chosen.point_m[:, :2]]))
        low = low - [0.0, _BAR_SHARE * (high - low).max()]  # the scale bar hides nothing there
        figure, (axes,) = map_figure(low, high, 1, origin, _BELOW_IN)
        if report.basemap is not None:
            draw_basemap(axes, report.basemap, origin, PALE_OPACITY)
        grid_ticks(axes, origin, report.frame.crs)
        _draw_allowed(axes, report)
        factor = ellipse_factor(answer, float((high - low).max()))
        rows = evenly_spaced_rows(answer.position_m, PATH_ELLIPSES)
        draw_ellipses(
            axes,
            answer.position_m[rows, :2],
            chosen.covariance_m2[rows][:, :2, :2],
            factor,
            facecolors="#0072B222",
            edgecolors=COLOUR["corrected"],
            linewidths=0.7,
            zorder=3,
        )
        axes.plot([], [], marker="o", markersize=9, linestyle="none", color="#0072B244", label="predicted 95 % ellipse")
        lines = _draw_path(axes, path_m[:, :2], sigma_m[:, 3])
        draw_ends(axes, path_m)
        _draw_sight(axes, report, answer)
        _draw_anchors(axes, report, answer, path_m[:, :2])
        scale_bar(axes)
        north_arrow(axes)
        shown = "true to scale" if factor == 1 else f"magnified {factor} times"
        what = "Given anchors" if report.predicted else f"{count_of(chosen)} planned anchors"
        axes.set_title(titled(f"{what} and predicted accuracy; ellipses {shown}", report.simulated), loc="left")
        _below(figure, axes, lines, float(sigma_m[:, 3].max()))
        return Picture(figure)


def _draw_allowed(axes: Axes, report: PlacementReport) -> None:
    if report.predicted:
        return
    for i, ring in enumerate(report.given.areas_en_m):
        closed = np.concatenate([ring, ring[:1]])
        label = "area allowed" if i == 0 else None
        axes.plot(*closed.T, color="#009E73", linewidth=1.1, linestyle="--", label=label, zorder=2)
    if report.given.candidate_m is not None:
        style = {"marker": "o", "markersize": 5, "linestyle": "none", "markerfacecolor": "none", "zorder": 4}
        axes.plot(*report.given.candidate_m[:, :2].T, color=EVEN, label="candidate", **style)


def _draw_path(axes: Axes, path_m: np.ndarray, sigma_m: np.ndarray) -> LineCollection:
    edges = np.stack([path_m[:-1], path_m[1:]], axis=1)
    lines = LineCollection(list(edges), cmap=colour_map(), linewidth=3.2, capstyle="round", zorder=4)
    lines.set_array(0.5 * (sigma_m[:-1] + sigma_m[1:]))
    axes.add_collection(lines, autolim=False)
    return lines


def _draw_sight(axes: Axes, report: PlacementReport, answer: PlacementAnswer) -> None:
    """Thin lines from every anchor to where the path passes it."""
    passed = visits_by_anchor(answer.chosen)
    origin = np.asarray(report.frame.origin_enh_m)
    ways = [
        np.array([point[:2], (at - origin)[:2]])
        for name, point in zip(answer.chosen.name, answer.chosen.point_m, strict=True)
        for at in place_on_path(report, answer, passed[name])
    ]
    axes.add_collection(LineCollection(ways, colors="#555555", linewidths=0.9, linestyles=":", zorder=5), autolim=False)
    axes.plot([], [], color="#555555", linewidth=0.9, linestyle=":", label="seen from here")


def _draw_anchors(axes: Axes, report: PlacementReport, answer: PlacementAnswer, path_m: np.ndarray) -> None:
    chosen, even = answer.chosen, layout_by(answer, "equal spacing")
    if even is not None and even is not chosen:
        new = [i for i, stands in enumerate(even.standing) if not stands]
        style = {"marker": "x", "markersize": 6, "markeredgewidth": 1.6, "linestyle": "none", "color": "#444444"}
        axes.plot(*even.point_m[new, :2].T, label="equal spacing, to compare", zorder=6, **style)
    label = "anchor, as given" if report.predicted else "anchor to be placed"
    for text, stands, colour, symbol in ((label, False, PLANNED, "^"), ("anchor that stands", True, STANDING, "s")):
        rows = [i for i, s in enumerate(chosen.standing) if s is stands]
        if rows:
            style = {"marker": symbol, "markersize": 9, "linestyle": "none", "markeredgecolor": "white", "zorder": 8}
            axes.plot(*chosen.point_m[rows, :2].T, color=colour, label=text, **style)
    label_points(axes, list(chosen.name), chosen.point_m[:, :2], path_m[thin(len(path_m), 800)])


def _below(figure: Figure, axes: Axes, lines: LineCollection, largest_m: float) -> None:
    """Legend and colour bar under the map."""
    height_in = figure.get_figheight()
    scale, unit = length_unit(largest_m)
    place = figure.add_axes((0.3, 0.4 / height_in, 0.4, 0.11 / height_in))
    bar = figure.colorbar(lines, cax=place, orientation="horizontal")
    bar.ax.xaxis.set_major_formatter(lambda value, _: f"{scale * value:g}")
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    place.grid(False)
    place.set_xlabel(f"predicted 1 sigma of the position, all axes [{unit}]", labelpad=1.0)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncol=4, bbox_to_anchor=(0.5, 0.56 / height_in), columnspacing=1.4
    )
