"""Along the path: height, standard deviations, and the error against a reference, by distance or by time."""

from typing import Any

import numpy as np

from jaxgeo.export.figure_style import COLOUR, STAGE_LABEL, distance_along_m, length_unit, thin
from jaxgeo.export.height_profile import height_asked_m
from jaxgeo.export.held_out_stats import STAGES
from jaxgeo.export.interactive import (
    GRID,
    MAX_POINTS,
    interactive_figure,
    layout,
    metre_axis,
    plot_text,
)
from jaxgeo.export.interactive_path import Columns, group_name, path_columns, shown_rows, thinning_words
from jaxgeo.export.result import SessionResult, TrajectoryResult

# Height of one panel, and the share of the figure between two of them.
PANEL_PX = 190
GAP = 0.06
# The names of the visits stand between the buttons and the first panel.
MARGIN = {"l": 72, "r": 14, "t": 54, "b": 50}
# Of all traces: either column can be on the x axis.
ALONG = {"distance": "distance_m", "time": "time_s"}


def interactive_profile(result: SessionResult, trajectory: TrajectoryResult, static: str = "") -> str:
    """HTML of the profiles; `static` is seen in their place on paper and without JavaScript."""
    against = " Errors are distances from the reference trajectory." if trajectory.reference else ""
    caption = (
        "Point at a profile, and the plan view above points at the same pose. Triangles: the height that each anchor "
        "asks for, reduced to the body; the band holds two sigma each way. The standard deviations are the model's own "
        f"claim: the held-out errors test it.{against}{thinning_words(trajectory)}"
    )
    return interactive_figure(
        profile_spec(result, trajectory),
        f"Profiles of {trajectory.name}, interactive",
        caption,
        static=static,
        group=group_name(result, trajectory),
    )


def profile_spec(result: SessionResult, trajectory: TrajectoryResult) -> dict[str, Any]:
    """What interactive.js draws: one panel above the other, with one x axis."""
    columns = profile_columns(result, trajectory)
    data = height_traces(trajectory)
    linked = len(data) - 2
    scale, unit = length_unit(float(np.nanmax([columns[f"sigma_{axis}"].max() for axis in "ENh"])))
    for axis in "ENh":
        columns[f"sigma_{axis}"] = (scale * columns[f"sigma_{axis}"]).round(4)
    data += sigma_traces(unit)
    titles = ["Height h [m]", f"1 sigma [{unit}]"]
    if trajectory.reference:
        error_columns, error_traces, title = reference_parts(trajectory)
        columns |= error_columns
        data += error_traces
        titles.append(title)
    axes = {
        axis: {"name": axis, "title": f"{what} [{unit}]", "head": f"%{{x:,.2f}} {unit}", "range": [0.0, float(end)]}
        for axis, what, unit, end in (
            ("distance", "Distance along the corrected path", "m", columns["distance_m"][-1]),
            ("time", "Time after the first pose", "s", columns["time_s"][-1]),
        )
    }
    return {
        "columns": columns,
        "data": data,
        "layout": layout(
            margin=MARGIN,
            hovermode="x unified",
            hoversubplots="axis",
            dragmode="zoom",
            xaxis=x_axis(axes["distance"], len(titles)),
            **y_axes(titles),
        ),
        "height_px": PANEL_PX * len(titles),
        "axes": axes,
        "lines": {
            "at": {axis: f"visit_{column}" for axis, column in ALONG.items()},
            "text": [plot_text(label) for label in trajectory.anchors.label],
        },
        "linked": linked,
    }


def profile_columns(result: SessionResult, trajectory: TrajectoryResult) -> Columns:
    """Of every shown pose, and (visit_..) of every visit."""
    path = path_columns(result, trajectory)
    rows, pose = shown_rows(trajectory), trajectory.anchors.pose_index
    at = np.searchsorted(rows, pose)
    coarse_m = trajectory.coarse_trajectory.position_m[rows, 2] + result.frame.origin_enh_m[2]
    columns = {name: path[name] for name in ("distance_m", "time_s", "h", "sigma_E", "sigma_N", "sigma_h")}
    return columns | {
        "coarse_h": coarse_m.round(3),
        "low_h": (path["h"] - 2.0 * path["sigma_h"]).round(3),
        "high_h": (path["h"] + 2.0 * path["sigma_h"]).round(3),
        "visit_distance_m": path["distance_m"][at],
        "visit_time_s": path["time_s"][at],
        "visit_h": (height_asked_m(trajectory) + result.frame.origin_enh_m[2]).round(3),
    }


def height_traces(trajectory: TrajectoryResult) -> list[dict[str, Any]]:
    """Band, one-time similarity, corrected height (the one to point at), visits: the last two in this order."""
    band = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "legendgroup": "band"}
    visit = {"x": {axis: f"visit_{column}" for axis, column in ALONG.items()}, "y": "visit_h"}
    return [
        {"name": "- 2 sigma", **band, **along("low_h"), "showlegend": False},
        {"name": "± 2 sigma", **band, **along("high_h"), "fill": "tonexty", "fillcolor": "rgba(0,114,178,0.2)"},
        {
            "name": STAGE_LABEL["coarse"],
            **along("coarse_h"),
            "mode": "lines",
            "line": {"color": COLOUR["coarse"], "width": 1.2},
            "hovertemplate": "%{y:,.3f} m",
        },
        {
            "name": "corrected height",
            **along("h"),
            "mode": "lines",
            "line": {"color": COLOUR["corrected"], "width": 2},
            "hovertemplate": "%{y:,.3f} m",
        },
        {
            "name": "visit",
            "columns": visit,
            "text": [plot_text(label) for label in trajectory.anchors.label],
            "hovertemplate": "%{text}: %{y:,.3f} m",
            "mode": "markers",
            "cliponaxis": False,
            "marker": {"symbol": "triangle-up", "size": 9, "color": COLOUR["anchor"]},
        },
    ]


def sigma_traces(unit: str) -> list[dict[str, Any]]:
    """One sigma of every axis."""
    dash = {"E": "solid", "N": "dash", "h": "dashdot"}
    return [
        {
            "name": f"sigma {axis}",
            **along(f"sigma_{axis}", panel=2),
            "mode": "lines",
            "line": {"color": COLOUR[axis], "width": 1.8, "dash": dash[axis]},
            "hovertemplate": f"%{{y:.2f}} {unit}",
        }
        for axis in "ENh"
    ]


def reference_parts(trajectory: TrajectoryResult) -> tuple[Columns, list[dict[str, Any]], str]:
    """Columns, traces and title of the errors against the reference, at the poses that have one."""
    stages = [stage for stage in STAGES if stage in trajectory.reference]
    largest = max(float(trajectory.reference[stage].error_m.max(initial=0.0)) for stage in stages)
    scale, unit = length_unit(largest)
    stamp_s = trajectory.corrected.stamp_s
    length_m = distance_along_m(trajectory.corrected.position_m)
    columns, traces = {}, []
    for stage in stages:
        reference = trajectory.reference[stage]
        rows = thin(len(reference.stamp_s), MAX_POINTS)
        at_s = reference.stamp_s[rows]
        columns[f"{stage}_time_s"] = (at_s - stamp_s[0]).round(3)
        columns[f"{stage}_distance_m"] = np.interp(at_s, stamp_s, length_m).round(3)
        columns[f"{stage}_error"] = (scale * reference.error_m[rows]).round(3)
        traces.append(
            {
                "name": f"error, {STAGE_LABEL[stage]}",
                "columns": {
                    "x": {axis: f"{stage}_{column}" for axis, column in ALONG.items()},
                    "y": f"{stage}_error",
                },
                "yaxis": "y3",
                "mode": "lines",
                "line": {"color": COLOUR[stage], "width": 1.5},
                "hovertemplate": f"%{{y:.2f}} {unit}",
            }
        )
    return columns, traces, f"Error [{unit}]"


def along(name: str, panel: int = 1) -> dict[str, Any]:
    """A trace of one value of every shown pose."""
    return {"columns": {"x": ALONG, "y": name}, "yaxis": "y" if panel == 1 else f"y{panel}"}


def x_axis(first: dict[str, Any], panels: int) -> dict[str, Any]:
    """Below the lowest panel, for all of them."""
    return metre_axis(
        first["title"],
        range=first["range"],
        anchor="y" if panels == 1 else f"y{panels}",
        nticks=9,
        unifiedhovertitle={"text": first["head"]},
        showspikes=True,
        spikemode="across",
        spikethickness=1,
        spikecolor="#555555",
    )


def y_axes(titles: list[str]) -> dict[str, Any]:
    """Panels of one height, the first on top."""
    height = (1.0 - GAP * (len(titles) - 1)) / len(titles)
    axes = {}
    for i, title in enumerate(titles):
        top = 1.0 - i * (height + GAP)
        place = {"domain": [max(top - height, 0.0), top], "anchor": "x", "nticks": 6}
        kept = metre_axis(title) if i == 0 else {**GRID, "title": {"text": title}, "rangemode": "tozero"}
        axes["yaxis" if i == 0 else f"yaxis{i + 1}"] = kept | place
    return axes
