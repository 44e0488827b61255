"""The map that answers the pointer: anchors, where they are seen from, and the path by its predicted accuracy."""

from typing import Any

import numpy as np

from eval.placement.answer import PlacementAnswer
from eval.placement_report.path_colour import colour_scale, coloured_path
from eval.placement_report.report import PlacementReport, count_of, layout_by, visits_by_anchor
from jaxgeo.export.figure_style import COLOUR, length_unit
from jaxgeo.export.interactive import interactive_figure, layout, metre_axis, plot_text
from jaxgeo.export.interactive_plan import ends, outlines, photo_under, steps, text_positions
from jaxgeo.export.map_axes import ellipse_shape, magnification, map_limits
from jaxgeo.export.number_words import grouped
from jaxgeo.export.plan_view import PATH_ELLIPSES, evenly_spaced_rows

HOVER = (
    "%{customdata[0]:,.1f} m along the path<br>E %{customdata[1]:,.2f} ± %{customdata[2]:.3f} m<br>"
    "N %{customdata[3]:,.2f} ± %{customdata[4]:.3f} m<br>h %{customdata[5]:,.2f} ± %{customdata[6]:.3f} m"
    "<extra></extra>"
)
HOVER_COLUMNS = ("distance_m", "E", "sigma_E", "N", "sigma_N", "h", "sigma_h")
PLANNED, STANDING, EVEN = "#D55E00", "#000000", "#8c8c8c"


def placement_map_figure(report: PlacementReport, answer: PlacementAnswer, static: str) -> str:
    """HTML; `static` is seen in its place on paper and without JavaScript."""
    caption = (
        "Point at the path for its predicted standard deviations, at an anchor for its coordinates and for where it is "
        "seen from; drag to zoom, click twice to return. Ellipses hold 95 of 100 errors; the slider sets how much "
        "larger than true they are drawn. A thin line leads from each anchor to where the path passes it."
    )
    return interactive_figure(
        map_spec(report, answer),
        f"Map of {count_of(answer.chosen)} anchors and the predicted accuracy, interactive",
        caption,
        static=static,
        group=group_name(report, answer),
    )


def group_name(report: PlacementReport, answer: PlacementAnswer) -> str:
    """Map and profile of one number of anchors point at the same place."""
    return f"{report.name}/{count_of(answer.chosen)}"


def map_spec(report: PlacementReport, answer: PlacementAnswer) -> dict[str, Any]:
    """What interactive.js draws."""
    columns = path_columns(report, answer)
    chosen = answer.chosen
    path = np.column_stack([columns["E"], columns["N"]])
    anchor = report.frame.to_grid(chosen.point_m)
    low, high = map_limits(np.concatenate([path, anchor[:, :2]]))
    factor = ellipse_factor(answer, float((high - low).max()))
    data = [*area_traces(report), *candidate_traces(report), ellipse_trace(report, answer), path_trace(columns)]
    linked = len(data) - 1
    data += ends(path)
    data += [sight_trace(report, answer), *even_traces(report, answer), *anchor_traces(report, answer, path)]
    return {
        "columns": columns,
        "data": data,
        "layout": layout(
            hovermode="closest",
            dragmode="zoom",
            margin={"l": 72, "r": 84, "t": 30, "b": 50},
            images=[] if report.basemap is None else [photo_under(report.basemap)],
            xaxis=metre_axis("Easting [m]", range=[low[0], high[0]], nticks=9),
            yaxis=metre_axis("Northing [m]", range=[low[1], high[1]], scaleanchor="x", scaleratio=1, nticks=9),
        ),
        "aspect": float((high - low)[1] / (high - low)[0]),
        "magnify": {"label": "Ellipses", "factors": steps(factor), "start": factor},
        "linked": linked,
    }


def ellipse_factor(answer: PlacementAnswer, map_size_m: float) -> int:
    """A round factor by which the path's ellipses can be seen."""
    size_m = ellipse_shape(answer.chosen.covariance_m2[:, :2, :2])[0] / 2.0
    return magnification(size_m, map_size_m, usual=0.05, most=0.13)


def path_columns(report: PlacementReport, answer: PlacementAnswer) -> dict[str, np.ndarray]:
    """Of points along the path: distance, time, grid coordinates, sigmas."""
    way_m, position_m, stamp_s, sigma_m = coloured_path(report, answer)
    grid = report.frame.to_grid(position_m)
    columns = {"distance_m": way_m.round(2), "time_s": (stamp_s - stamp_s[0]).round(2)}
    columns |= {axis: grid[:, i].round(3) for i, axis in enumerate("ENh")}
    columns |= {f"sigma_{axis}": sigma_m[:, i].round(5) for i, axis in enumerate("ENh")}
    return columns | {"sigma": sigma_m[:, 3].round(5)}


def path_trace(columns: dict[str, np.ndarray]) -> dict[str, Any]:
    """The path, coloured; the one to point at."""
    scale, unit = length_unit(float(columns["sigma"].max()))
    bar = {"title": {"text": f"1 sigma<br>[{unit}]"}, "thickness": 14, "len": 0.9, "outlinewidth": 0}
    marker = {"color": (scale * columns["sigma"]).round(4), "colorscale": colour_scale(), "size": 5, "colorbar": bar}
    return {
        "name": "path, by predicted 1 sigma",
        "columns": {"x": "E", "y": "N"},
        "hover": HOVER_COLUMNS,
        "hovertemplate": HOVER,
        "mode": "markers",
        "marker": marker,
    }


def ellipse_trace(report: PlacementReport, answer: PlacementAnswer) -> dict[str, Any]:
    """95 % ellipses along the path."""
    rows = evenly_spaced_rows(answer.position_m, PATH_ELLIPSES)
    centre = report.frame.to_grid(answer.position_m[rows])[:, :2]
    return {
        "name": "predicted 95 % ellipse",
        "magnified": outlines(centre, answer.chosen.covariance_m2[rows][:, :2, :2]),
        "mode": "lines",
        "fill": "toself",
        "fillcolor": "rgba(0,114,178,0.10)",
        "line": {"color": COLOUR["corrected"], "width": 0.8},
        "hoverinfo": "skip",
    }


def area_traces(report: PlacementReport) -> list[dict[str, Any]]:
    """Outlines of where anchors may stand."""
    rings = report.given.areas_en_m
    if not rings or report.predicted:
        return []
    origin = np.asarray(report.frame.origin_enh_m)[:2]
    gap = np.full((1, 2), np.nan)
    xy = np.concatenate([part for ring in rings for part in (ring + origin, ring[:1] + origin, gap)])
    line = {"color": "#009E73", "width": 1.2, "dash": "dash"}
    return [
        {
            "name": "area allowed",
            "x": xy[:, 0].round(3),
            "y": xy[:, 1].round(3),
            "mode": "lines",
            "line": line,
            "hoverinfo": "skip",
        }
    ]


def candidate_traces(report: PlacementReport) -> list[dict[str, Any]]:
    """Places that could have been chosen."""
    if report.given.candidate_m is None or report.predicted:
        return []
    return [
        {
            "name": "candidate",
            **points(report, report.given.candidate_name, report.given.candidate_m, None),
            "mode": "markers",
            "marker": {"symbol": "circle-open", "size": 7, "color": EVEN},
        }
    ]


def sight_trace(report: PlacementReport, answer: PlacementAnswer) -> dict[str, Any]:
    """From every anchor to the places of the path where its visits are."""
    chosen = answer.chosen
    origin = report.frame.to_grid(chosen.point_m)
    passed = visits_by_anchor(chosen)
    parts = [np.zeros((0, 2))]
    for name, point in zip(chosen.name, origin, strict=True):
        for at in place_on_path(report, answer, passed[name]):
            parts += [np.array([point[:2], at[:2], [np.nan, np.nan]])]
    xy = np.concatenate(parts)
    return {
        "name": "seen from here",
        "x": xy[:, 0].round(3),
        "y": xy[:, 1].round(3),
        "mode": "lines",
        "line": {"color": "#555555", "width": 1, "dash": "dot"},
        "hoverinfo": "skip",
    }


def place_on_path(report: PlacementReport, answer: PlacementAnswer, distance_m: list[float]) -> np.ndarray:
    """Grid position of the path so far along it."""
    way_m, position_m, _, _ = coloured_path(report, answer)
    share = np.asarray(distance_m) / answer.distance_m[-1] * way_m[-1]
    return report.frame.to_grid(np.column_stack([np.interp(share, way_m, axis) for axis in position_m.T]))


def even_traces(report: PlacementReport, answer: PlacementAnswer) -> list[dict[str, Any]]:
    """Where equal spacing would put them, for comparison."""
    even = layout_by(answer, "equal spacing")
    if even is None or even is answer.chosen:
        return []
    new = [i for i, stands in enumerate(even.standing) if not stands]
    return [
        {
            "name": "equal spacing, for comparison",
            **points(report, [even.name[i] for i in new], even.point_m[new], None),
            "mode": "markers",
            "marker": {"symbol": "x-thin-open", "size": 8, "color": "#444444", "line": {"width": 2}},
        }
    ]


def anchor_traces(report: PlacementReport, answer: PlacementAnswer, path: np.ndarray) -> list[dict[str, Any]]:
    """The chosen anchors with their names, then those that stand."""
    chosen, passed = answer.chosen, visits_by_anchor(answer.chosen)
    every = text_positions(list(chosen.name), report.frame.to_grid(chosen.point_m)[:, :2], path)
    traces = []
    kinds = (("anchor, as given" if report.predicted else "anchor to be placed", False, PLANNED, "triangle-up"),)
    kinds += (("anchor that stands", True, STANDING, "square"),)
    for label, stands, colour, symbol in kinds:
        rows = [i for i, s in enumerate(chosen.standing) if s is stands]
        if not rows:
            continue
        names = [chosen.name[i] for i in rows]
        said = [", ".join(f"{x:.0f}" for x in passed[name]) for name in names]
        traces.append(
            {
                "name": label,
                **points(report, names, chosen.point_m[rows], said),
                "mode": "markers+text",
                "marker": {"symbol": symbol, "size": 12, "color": colour, "line": {"color": "#ffffff", "width": 1}},
                "textposition": [every[i] for i in rows],
                "textfont": {"size": 13.5, "weight": "bold"},
            }
        )
    return traces


def points(report: PlacementReport, name, point_m: np.ndarray, passed: list[str] | None) -> dict[str, Any]:
    """Coordinates, names and hover boxes of places; `passed` at which distances, in metres."""
    grid = report.frame.to_grid(point_m)
    text = []
    for i, (n, p) in enumerate(zip(name, grid, strict=True)):
        lines = [f"<b>{plot_text(n)}</b>", *(f"{axis} {grouped(x, 3)} m" for axis, x in zip("ENh", p, strict=True))]
        if passed is not None:
            lines.append(f"passed at {passed[i]} m along the path" if passed[i] else "not seen from the path")
        text.append("<br>".join(lines))
    return {
        "x": grid[:, 0].round(3),
        "y": grid[:, 1].round(3),
        "text": [plot_text(n) for n in name],
        "hovertext": text,
        "hovertemplate": "%{hovertext}<extra></extra>",
    }
