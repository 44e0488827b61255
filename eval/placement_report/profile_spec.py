"""Predicted standard deviations along the path, with the places where anchors are passed."""

from typing import Any

import numpy as np

from eval.placement.answer import PlacementAnswer
from eval.placement_report.map_spec import group_name, path_columns
from eval.placement_report.report import PlacementReport, count_of, layout_by, sigma_along_m
from jaxgeo.export.figure_style import COLOUR, length_unit
from jaxgeo.export.interactive import GRID, interactive_figure, layout, plot_text
from jaxgeo.export.interactive_profile import ALONG, MARGIN, PANEL_PX, along, x_axis


def profile_figure(report: PlacementReport, answer: PlacementAnswer) -> str:
    """HTML; seen with JavaScript only: on paper, the map and the tables say the same."""
    caption = (
        "Predicted standard deviations along the path. Dotted lines: where an anchor is passed. Point at the profile, "
        "and the map above points at the same place."
    )
    return interactive_figure(
        profile_spec(report, answer),
        f"Predicted accuracy along the path with {count_of(answer.chosen)} anchors, interactive",
        caption,
        group=group_name(report, answer),
    )


def profile_spec(report: PlacementReport, answer: PlacementAnswer) -> dict[str, Any]:
    """What interactive.js draws."""
    columns = path_columns(report, answer)
    even = layout_by(answer, "equal spacing")
    compared = even is not None and even is not answer.chosen and np.isfinite(even.accuracy_m[answer.criterion])
    if even is not None and compared:
        share, at = columns["distance_m"] / columns["distance_m"][-1], answer.distance_m / answer.distance_m[-1]
        columns["sigma_even"] = np.interp(share, at, sigma_along_m(answer, even)[:, 3])
    names = [name for name in columns if name.startswith("sigma")]
    scale, unit = length_unit(float(max(columns[name].max() for name in names)))
    columns |= {name: (scale * columns[name]).round(4) for name in names}
    columns |= visit_columns(report, answer, columns)
    data = [sigma_trace(name, unit) for name in names]
    axes = {
        axis: {"name": axis, "title": f"{what} [{u}]", "head": f"%{{x:,.1f}} {u}", "range": [0.0, float(end)]}
        for axis, what, u, end in (
            ("distance", "Distance along the path", "m", columns["distance_m"][-1]),
            ("time", "Time after the start", "s", columns["time_s"][-1]),
        )
    }
    return {
        "columns": columns,
        "data": data,
        "layout": layout(
            margin=MARGIN,
            hovermode="x unified",
            dragmode="zoom",
            xaxis=x_axis(axes["distance"], 1),
            yaxis={**GRID, "title": {"text": f"Predicted 1 sigma [{unit}]"}, "rangemode": "tozero", "nticks": 6},
        ),
        "height_px": 1.4 * PANEL_PX,
        "axes": axes,
        "lines": {
            "at": {axis: f"visit_{column}" for axis, column in ALONG.items()},
            "text": [plot_text(visit.location) for visit in answer.chosen.visits],
        },
        "linked": names.index("sigma"),
    }


def visit_columns(
    report: PlacementReport, answer: PlacementAnswer, columns: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Distance and time of every visit."""
    share = np.array([visit.distance_m for visit in answer.chosen.visits]) / answer.distance_m[-1]
    at_m = share * columns["distance_m"][-1]
    at_s = np.interp(at_m, columns["distance_m"], columns["time_s"])
    return {"visit_distance_m": at_m.round(2), "visit_time_s": at_s.round(2)}


def sigma_trace(name: str, unit: str) -> dict[str, Any]:
    """One standard deviation; `sigma` is of all axes together."""
    if name == "sigma":
        label, line = "all axes", {"color": "#000000", "width": 2.4, "dash": "solid"}
    elif name == "sigma_even":
        label, line = "all axes, equal spacing", {"color": COLOUR["coarse"], "width": 1.8, "dash": "solid"}
    else:
        axis = name.removeprefix("sigma_")
        dash = {"E": "solid", "N": "dash", "h": "dashdot"}[axis]
        label, line = axis, {"color": COLOUR[axis], "width": 1.6, "dash": dash}
    return {"name": label, **along(name), "mode": "lines", "line": line, "hovertemplate": f"%{{y:.2f}} {unit}"}
