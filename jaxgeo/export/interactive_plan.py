"""The plan view that answers the pointer: every pose's coordinates and sigma, errors drawn as large as one asks for."""

import base64
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from jaxgeo.export.basemap import PALE_OPACITY
from jaxgeo.export.figure_style import COLOUR, STAGE_LABEL
from jaxgeo.export.held_out_stats import chi_square_quantile, final_stage, normalised_squared_errors
from jaxgeo.export.interactive import interactive_figure, layout, metre_axis, plot_text
from jaxgeo.export.interactive_path import (
    POSE_COLUMNS,
    POSE_HOVER,
    group_name,
    path_columns,
    shown_rows,
    thinning_words,
)
from jaxgeo.export.label_placement import DIRECTIONS, crowding
from jaxgeo.export.map_axes import MAGNIFICATIONS, map_limits
from jaxgeo.export.number_words import decimal, grouped, length_words
from jaxgeo.export.plan_view import PATH_ELLIPSES, evenly_spaced_rows, plan_factor
from jaxgeo.export.result import HeldOut, SessionResult, TrajectoryResult
from jaxgeo.io.orthophoto import Orthophoto

# Points on the outline of an ellipse.
OUTLINE = 48
# The longer side of the map on a usual screen.
MAP_PX = 800.0
VERTICAL = {1: "top", 0: "middle", -1: "bottom"}
HORIZONTAL = {1: "right", 0: "center", -1: "left"}


def interactive_plan(result: SessionResult, trajectory: TrajectoryResult, static: str = "") -> str:
    """HTML of the plan view; `static` is seen in its place on paper and without JavaScript."""
    stage = final_stage(trajectory)
    held_out = trajectory.held_out.get(stage)
    shown = (
        f"its arrow (error, {STAGE_LABEL[stage]}) and ellipse (95 %) when its location was held out. An arrow that "
        "ends inside its ellipse is an error as large as predicted."
    )
    caption = (
        "Point at the path for time, length of the path, grid coordinates and one sigma (±); drag to zoom, click twice "
        f"to return. {'At every anchor ' + shown if held_out else 'No location was held out.'}"
        f"{thinning_words(trajectory)}"
    )
    return interactive_figure(
        plan_spec(result, trajectory),
        f"Plan view of {trajectory.name}, interactive",
        caption,
        static=static,
        group=group_name(result, trajectory),
    )


def plan_spec(result: SessionResult, trajectory: TrajectoryResult) -> dict[str, Any]:
    """What interactive.js draws."""
    rows = shown_rows(trajectory)
    columns = path_columns(result, trajectory)
    coarse = result.frame.to_grid(trajectory.coarse_trajectory.position_m[rows]).round(3)
    columns |= {"coarse_E": coarse[:, 0], "coarse_N": coarse[:, 1]}
    surveyed = result.frame.to_grid(trajectory.anchors.surveyed_enh_m)
    path = np.column_stack([columns["E"], columns["N"]])
    low, high = map_limits(np.concatenate([path, coarse[:, :2], surveyed[:, :2]]))
    factor = plan_factor(trajectory, float((high - low).max()))
    data = [*path_traces(result, trajectory)]
    linked = len(data) - 1
    data += ends(path)
    held_out = trajectory.held_out.get(final_stage(trajectory))
    if held_out is not None:
        data += held_out_traces(trajectory, held_out, surveyed)
    data += point_traces(result, trajectory)
    return {
        "columns": columns,
        "data": data,
        "layout": layout(
            hovermode="closest",
            dragmode="zoom",
            images=[] if result.basemap is None else [photo_under(result.basemap)],
            xaxis=metre_axis("Easting [m]", range=[low[0], high[0]], nticks=9),
            yaxis=metre_axis("Northing [m]", range=[low[1], high[1]], scaleanchor="x", scaleratio=1, nticks=9),
        ),
        "aspect": float((high - low)[1] / (high - low)[0]),
        "magnify": {"label": "Ellipses and errors", "factors": steps(factor), "start": factor},
        "linked": linked,
    }


def photo_under(photo: Orthophoto) -> dict[str, Any]:
    """The orthophoto as a picture under the map, paler than what is drawn over it."""
    west, south, east, north = photo.bounds_en_m
    return {
        "source": f"data:image/jpeg;base64,{base64.b64encode(jpeg(photo.rgba)).decode('ascii')}",
        "xref": "x",
        "yref": "y",
        "x": west,
        "y": north,
        "sizex": east - west,
        "sizey": north - south,
        "sizing": "stretch",
        "opacity": PALE_OPACITY,
        "layer": "below",
    }


def jpeg(rgba: UInt8[np.ndarray, "h w 4"]) -> bytes:
    """On white where it is transparent: a photograph as PNG would be ten times as large."""
    opacity = rgba[..., 3:] / 255.0
    on_white = np.round(opacity * rgba[..., 2::-1] + (1.0 - opacity) * 255.0).astype(np.uint8)
    return cv2.imencode(".jpg", on_white, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


def steps(factor: int) -> list[int]:
    """Magnifications that the slider offers: from true to scale to well beyond the one it starts with."""
    at = MAGNIFICATIONS.index(factor)
    return list(MAGNIFICATIONS[: max(at + 3, 6)])


def path_traces(result: SessionResult, trajectory: TrajectoryResult) -> list[dict[str, Any]]:
    """One-time similarity, ellipses of the path, corrected path: the last one is the one to point at."""
    rows = evenly_spaced_rows(trajectory.corrected.position_m, PATH_ELLIPSES)
    centre = result.frame.to_grid(trajectory.corrected.position_m[rows])[:, :2]
    return [
        {
            "name": STAGE_LABEL["coarse"],
            "columns": {"x": "coarse_E", "y": "coarse_N"},
            "mode": "lines",
            "line": {"color": COLOUR["coarse"], "width": 1.3},
            "hoverinfo": "skip",
        },
        {
            "name": "95 % ellipse of the path",
            "magnified": outlines(centre, trajectory.covariance[rows][:, :2, :2]),
            "mode": "lines",
            "fill": "toself",
            "fillcolor": "rgba(0,114,178,0.10)",
            "line": {"color": COLOUR["corrected"], "width": 0.8},
            "hoverinfo": "skip",
        },
        {
            "name": "corrected",
            "columns": {"x": "E", "y": "N"},
            "hover": POSE_COLUMNS,
            "hovertemplate": POSE_HOVER + "<extra></extra>",
            "mode": "lines",
            "line": {"color": COLOUR["corrected"], "width": 2},
        },
    ]


def ends(path: np.ndarray) -> list[dict[str, Any]]:
    """Start and end of the path."""
    line = {"color": COLOUR["corrected"], "width": 1.5}
    return [
        {
            "name": name,
            "x": [path[row, 0]],
            "y": [path[row, 1]],
            "mode": "markers",
            "marker": {"symbol": symbol, "size": 10, "color": "#ffffff", "line": line},
            "hoverinfo": "skip",
        }
        for name, row, symbol in (("start", 0, "circle"), ("end", -1, "square"))
    ]


def held_out_traces(trajectory: TrajectoryResult, held_out: HeldOut, surveyed: np.ndarray) -> list[dict[str, Any]]:
    """Ellipse and error of every visit, from its surveyed point; the figures stand at the tip of the arrow."""
    k = len(surveyed)
    error = held_out.error_enh_m[:, :2]
    known = np.isfinite(error).all(axis=1)
    nothing = np.full(k, np.nan)
    text = [error_text(trajectory, held_out, j) for j in range(k)]

    def stretch(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        return np.column_stack([start, end, nothing])[known].ravel()

    return [
        {
            "name": "95 % ellipse, anchor held out",
            "magnified": outlines(surveyed[:, :2], held_out.covariance_m2[:, :2, :2]),
            "mode": "lines",
            "line": {"color": COLOUR["error"], "width": 1.3},
            "hoverinfo": "skip",
        },
        {
            "name": "error, anchor held out",
            "magnified": {
                "x": stretch(surveyed[:, 0], surveyed[:, 0]),
                "y": stretch(surveyed[:, 1], surveyed[:, 1]),
                "dx": stretch(np.zeros(k), error[:, 0].round(4)),
                "dy": stretch(np.zeros(k), error[:, 1].round(4)),
            },
            "text": [t for j in np.flatnonzero(known) for t in ("", text[j], "")],
            "hovertemplate": "%{text}<extra></extra>",
            "mode": "lines+markers",
            "line": {"color": COLOUR["error"], "width": 2},
            "marker": {
                "symbol": "arrow",
                "angleref": "previous",
                "size": [0, 11, 0] * int(known.sum()),
                "color": COLOUR["error"],
                "opacity": 1.0,
                "line": {"width": 0},
            },
        },
    ]


def error_text(trajectory: TrajectoryResult, held_out: HeldOut, j: int) -> str:
    """One visit's held-out error, axis by axis beside what was predicted for it."""
    error, covariance = held_out.error_enh_m[j], held_out.covariance_m2[j]
    sigma = np.sqrt(np.diagonal(covariance))
    nees = normalised_squared_errors(error[None], covariance[None])[0]
    lines = [
        f"<b>{plot_text(trajectory.anchors.label[j])}</b>, held out: {length_words(float(np.linalg.norm(error)))} off"
    ]
    lines += [f"d{axis} {decimal(error[i], 3)} m, predicted ± {decimal(sigma[i], 3)} m" for i, axis in enumerate("ENh")]
    return "<br>".join([*lines, f"NEES {decimal(nees, 1)} (about 3 expected)"])


def point_traces(result: SessionResult, trajectory: TrajectoryResult) -> list[dict[str, Any]]:
    """Anchors by location, with their visits; then the surveyed points that were not used."""
    anchors = trajectory.anchors
    visits = {name: [] for name in anchors.location}
    for label, location in zip(anchors.label, anchors.location, strict=True):
        visits[location].append(label)
    first = [anchors.location.index(name) for name in visits]
    surveyed = result.frame.to_grid(anchors.surveyed_enh_m[first])
    unused = {name: point for name, point in result.survey_enh_m.items() if name not in visits}
    path_m = result.frame.to_grid(trajectory.corrected.position_m[shown_rows(trajectory)])[:, :2]
    traces = [
        {
            "name": "anchor",
            **points(list(visits), surveyed, [f"visits: {', '.join(labels)}" for labels in visits.values()]),
            "mode": "markers+text",
            "marker": {"symbol": "triangle-up", "size": 10, "color": COLOUR["anchor"]},
            "textposition": text_positions(list(visits), surveyed[:, :2], path_m),
            "textfont": {"size": 13.5, "weight": "bold"},
        }
    ]
    if unused:
        grid = result.frame.to_grid(np.array(list(unused.values())))
        traces.append(
            {
                "name": "surveyed, not used",
                **points(list(unused), grid, ["no visit"] * len(unused)),
                "mode": "markers",
                "marker": {"symbol": "triangle-up-open", "size": 9, "color": COLOUR["unused"]},
            }
        )
    return traces


def points(name: list[str], grid_m: np.ndarray, said: list[str]) -> dict[str, Any]:
    """Coordinates, names and hover boxes of surveyed points."""
    text = [
        "<br>".join(
            [
                f"<b>{plot_text(n)}</b> as surveyed",
                *(f"{axis} {grouped(x, 3)} m" for axis, x in zip("ENh", p, strict=True)),
                plot_text(s),
            ]
        )
        for n, p, s in zip(name, grid_m, said, strict=True)
    ]
    return {
        "x": grid_m[:, 0].round(4),
        "y": grid_m[:, 1].round(4),
        "text": [plot_text(n) for n in name],
        "hovertext": text,
        "hovertemplate": "%{hovertext}<extra></extra>",
    }


def text_positions(name: list[str], point_m: np.ndarray, path_m: np.ndarray) -> list[str]:
    """On which side of its point each name hides least of the path, the points and the other names."""
    everything = np.concatenate([point_m, path_m])
    px_per_m = MAP_PX / max(float(np.ptp(everything, axis=0).max()), 1.0)
    obstacle = px_per_m * everything
    low, high = np.zeros((0, 2)), np.zeros((0, 2))
    chosen = []
    for text, point in zip(name, px_per_m * point_m, strict=True):
        size = np.array([9.0 * len(text) + 4.0, 18.0])
        centre = point + DIRECTIONS * (6.0 + size / 2.0)
        i = int(np.argmin(crowding(centre, size, obstacle, (low, high)) + 1e-3 * np.arange(len(DIRECTIONS))))
        low, high = np.vstack([low, centre[i] - size / 2.0]), np.vstack([high, centre[i] + size / 2.0])
        across, up = DIRECTIONS[i].astype(int)
        chosen.append(f"{VERTICAL[up]} {HORIZONTAL[across]}")
    return chosen


def outlines(centre: np.ndarray, covariance_m2: np.ndarray) -> dict[str, np.ndarray]:
    """95 % ellipses as one broken line: centres, and the way from them to the outline; rows with NaN are left out."""
    rows = np.isfinite(covariance_m2).all(axis=(1, 2))
    eigenvalues, axes = np.linalg.eigh(covariance_m2[rows])
    half = np.sqrt(chi_square_quantile(0.95, 2) * np.clip(eigenvalues, 0.0, None))
    turn = np.linspace(0.0, 2.0 * np.pi, OUTLINE)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    way = np.einsum("kij,kj,jm->kim", axes, half, circle).round(4)
    way = np.concatenate([way, np.full((*way.shape[:2], 1), np.nan)], axis=2)
    start = np.broadcast_to(centre[rows].round(3)[:, :, None], way.shape)
    return {"x": start[:, 0].ravel(), "y": start[:, 1].ravel(), "dx": way[:, 0].ravel(), "dy": way[:, 1].ravel()}
