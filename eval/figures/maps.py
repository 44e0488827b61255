"""Maps of a study: corrected trajectories over the site, and each trajectory before and after its correction."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from eval.figures.picture import Picture
from eval.figures.series_style import series_line, titled
from jaxgeo.export.basemap import draw_basemap, grid_ticks, north_arrow, scale_bar
from jaxgeo.export.before_after import before_after_figure
from jaxgeo.export.figure_style import COLOUR, figure_style, legend_below, thin
from jaxgeo.export.label_placement import label_points
from jaxgeo.export.map_axes import map_figure, map_limits
from jaxgeo.export.result import SessionResult, TrajectoryResult
from jaxgeo.io.orthophoto import Orthophoto

MAX_VERTICES = 4_000  # of one line: several lie in one map, each drawn twice, once as its halo
LINE_PT = 1.9
HALO_PT = 2.4
LEGEND_COLUMNS = 3
LEGEND_ROW_IN = 0.2


def trajectories_map(
    trajectories: Mapping[str, Float[np.ndarray, "_ 2"]],
    survey: Mapping[str, Float[np.ndarray, "2"]],
    origin_enh_m: Float[np.ndarray, "3"],
    crs: str,
    orthophoto: Orthophoto | None = None,
    simulated: bool = False,
) -> Picture:
    """Corrected trajectories and surveyed points over an orthophoto, or over the plain grid.

    Args:
        trajectories: by the name in the legend: E, N in the local frame, metres.
        survey: by the name of the point: E, N in the local frame, metres. Points far from all trajectories are left
            out: they would make the site a dot.
        origin_enh_m: of the local frame; the axes show grid coordinates, that is local ones plus the origin.
        crs: in words, for the axis: `EPSG:2169`.
        orthophoto: from `jaxgeo.export.basemap.read_basemap` of these points.
    """
    with figure_style():
        survey = near(survey, np.concatenate(list(trajectories.values())))
        points = np.array(list(survey.values())).reshape(-1, 2)
        low, high = map_limits(np.concatenate([*trajectories.values(), points]))
        columns = min(LEGEND_COLUMNS, len(trajectories) + 1)
        legend_rows = -(-(len(trajectories) + bool(survey)) // columns)
        figure, (axes,) = map_figure(low, high, 1, np.asarray(origin_enh_m), LEGEND_ROW_IN * max(0, legend_rows - 1))
        if orthophoto is not None:
            draw_basemap(axes, orthophoto, origin_enh_m)
        grid_ticks(axes, origin_enh_m, crs)
        for i, (name, xy) in enumerate(trajectories.items()):
            line = xy[thin(len(xy), MAX_VERTICES)].T
            # White below all lines, so that each stands out from the photo and none is hidden by another's halo
            axes.plot(*line, color="white", linewidth=LINE_PT + HALO_PT, solid_capstyle="round", zorder=3)
            axes.plot(*line, label=name, linewidth=LINE_PT, zorder=4, **series_line(i))
        draw_survey(axes, survey, np.concatenate([points, *(x[thin(len(x), 800)] for x in trajectories.values())]))
        scale_bar(axes)
        north_arrow(axes)
        axes.set_title(titled("Corrected trajectories and surveyed points", simulated), loc="left")
        legend_below(axes, columns, drop=0.47 / (figure.get_figheight() * axes.get_position().height))
        return Picture(figure)


def near(survey: Mapping[str, np.ndarray], path: Float[np.ndarray, "n 2"]) -> dict[str, np.ndarray]:
    """The points no farther from the box around the paths than that box is long."""
    low, high = path.min(axis=0), path.max(axis=0)
    reach = float((high - low).max())
    return {name: p for name, p in survey.items() if ((p >= low - reach) & (p <= high + reach)).all()}


def draw_survey(axes: Axes, survey: Mapping[str, np.ndarray], obstacle: Float[np.ndarray, "m 2"]) -> None:
    """Surveyed points as triangles with their names; nothing where there are none."""
    if not survey:
        return
    points = np.array(list(survey.values()))
    style = {"marker": "^", "markersize": 8, "linestyle": "none", "markeredgecolor": "white", "markeredgewidth": 1.0}
    axes.plot(*points.T, color=COLOUR["anchor"], label="surveyed point", zorder=7, **style)
    label_points(axes, list(survey), points, obstacle)


def before_after_map(result: SessionResult, trajectory: TrajectoryResult) -> Picture:
    """One trajectory after the one-time similarity and after its correction, with what is left at every anchor."""
    figure = before_after_figure(result, trajectory)
    if result.simulated:
        figure.text(0.995, 0.01, "simulated data", ha="right", va="bottom", fontsize=9, color="#444444")
    return Picture(figure)
