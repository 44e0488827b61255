"""plan.json: the whole answer, grid coordinates, and what it was made from."""

from typing import Any

import numpy as np

from eval.placement.answer import PlacementAnswer, PlannedLayout, WhatIf
from eval.placement_report.point_files import kind, wgs84
from eval.placement_report.report import PlacementReport, count_of, gain, sigma_along_m
from jaxgeo.export.json_text import json_text


def plan_text(report: PlacementReport, files: list[str], not_written: dict[str, str]) -> str:
    """Strict JSON. An accuracy of null: the layout does not fix the frame."""
    given = report.given
    return json_text(
        {
            "kind": "prediction" if report.predicted else "placement",
            "name": report.name,
            "simulated": report.simulated,
            "frame": report.frame.as_dict(),
            "criterion": given.criterion,
            "robust": given.robust,
            "path": {
                "source": report.path_said,
                "poses": len(report.path),
                "length_m": report.path_length_m,
                "duration_s": report.path.stamp_s[-1] - report.path.stamp_s[0],
            },
            "noise": report.noise,
            "assumed": {
                "range_m": given.range_m,
                "sighting_sigma_m": given.sighting_sigma_m,
                "survey_sigma_enh_m": given.survey_sigma_m,
                "apart_m": given.apart_m,
                "most_passes": given.most_passes,
                "reach_m": given.reach_m,
                "height_above_path_m": given.lift_m,
            },
            "plans": [plan_values(report, answer) for answer in report.answers],
            "warnings": report.warnings,
            **report.run,
            "config": report.config,
            "files": files,
            "not_written": not_written,
        }
    )


def plan_values(report: PlacementReport, answer: PlacementAnswer) -> dict[str, Any]:
    """One number of anchors: the chosen layout, the layouts compared, what if."""
    chosen, sensitivity = answer.chosen, answer.sensitivity
    return {
        "count": count_of(chosen),
        "chosen": chosen.method,
        "accuracy_m": chosen.accuracy_m,
        "gain_over_equal_spacing": gain(answer, chosen),
        "anchors": anchor_values(report, chosen, lonlat=wgs84(report, answer) if report.frame.has_datum else None),
        "along_path": along_path(report, answer),
        "layouts": [layout_values(report, answer, layout) for layout in answer.layouts],
        "what_if": [what_if_values(report, change) for change in answer.what_if],
        "sensitivity": {
            "survey_sigma": sensitivity.survey_sigma,
            "sighting_sigma": sensitivity.sighting_sigma,
            "noise": sensitivity.noise,
            "position_per_m_EN": dict(zip(chosen.name, sensitivity.position_per_m.tolist(), strict=True)),
        },
        "starts": answer.starts,
        "starts_near_best": answer.starts_near_best,
    }


def anchor_values(
    report: PlacementReport, layout: PlannedLayout, lonlat: list[list[float]] | None = None
) -> list[dict[str, Any]]:
    """Name, kind and E, N, h of every anchor, and longitude and latitude where asked for."""
    found = []
    for i, point in enumerate(report.frame.to_grid(layout.point_m)):
        one = {"name": layout.name[i], "kind": kind(report, layout.standing[i])}
        one |= dict(zip("ENh", point.tolist(), strict=True))
        found.append(one if lonlat is None else one | {"lon_deg": lonlat[i][0], "lat_deg": lonlat[i][1]})
    return found


def along_path(report: PlacementReport, answer: PlacementAnswer) -> dict[str, Any]:
    """Columns over the watched points: where, and how accurate with the chosen layout."""
    grid, sigma = report.frame.to_grid(answer.position_m), sigma_along_m(answer, answer.chosen)
    columns: dict[str, Any] = {"distance_m": answer.distance_m}
    columns |= {axis: grid[:, i] for i, axis in enumerate("ENh")}
    columns |= {f"sigma_{axis}_m": sigma[:, i] for i, axis in enumerate("ENh")}
    covariance = answer.chosen.covariance_m2
    return columns | {
        "sigma_m": sigma[:, 3],
        "covariance_EN_m2": covariance[:, 0, 1],
        "covariance_Eh_m2": covariance[:, 0, 2],
        "covariance_Nh_m2": covariance[:, 1, 2],
    }


def layout_values(report: PlacementReport, answer: PlacementAnswer, layout: PlannedLayout) -> dict[str, Any]:
    """One of the layouts compared."""
    return {
        "method": layout.method,
        "accuracy_m": layout.accuracy_m,
        "gain_over_equal_spacing": gain(answer, layout),
        "anchors": anchor_values(report, layout),
        "visits": [vars(visit) for visit in layout.visits],
        "seconds": layout.seconds,
    }


def what_if_values(report: PlacementReport, change: WhatIf) -> dict[str, Any]:
    """One change; `E`, `N`, `h` where it is about a place."""
    grid = np.full(3, np.nan) if change.point_m is None else report.frame.to_grid(change.point_m)
    return {
        "change": change.change,
        "marker": change.marker or None,
        **dict(zip("ENh", grid.tolist(), strict=True)),
        "further_m": change.further_m,
        "accuracy_m": change.accuracy_m,
    }
