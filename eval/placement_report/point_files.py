"""The planned anchors as a table for the surveyor and as GeoJSON for a map viewer."""

from typing import Any

import numpy as np

from eval.placement.answer import PlacementAnswer
from eval.placement_report.report import PlacementReport, visits_by_anchor
from jaxgeo.export.csv_text import csv_text, one_line
from jaxgeo.export.json_text import json_text

# Of coordinates in files for people: a marker is not put up to better than a millimetre.
_DIGITS = 3


def anchors_csv(report: PlacementReport, answer: PlacementAnswer) -> str:
    """`name,E,N,h,kind`: a survey file, once the coordinates are those measured."""
    frame, chosen = report.frame, answer.chosen
    grid = np.round(report.frame.to_grid(chosen.point_m), _DIGITS)
    comments = ["SIMULATED DATA: not a measurement"] if report.simulated else []
    comments += [
        f"jaxgeo anchors {'as given' if report.predicted else 'planned, not measured'}",
        f"plan: {one_line(report.name)}",
        f"crs: {frame.crs} ({frame.crs_name}); height: {frame.height}; metres",
    ]
    rows = [
        (name, *point, kind(report, stands))
        for name, stands, point in zip(chosen.name, chosen.standing, grid.tolist(), strict=True)
    ]
    return csv_text(comments, ("name", "E", "N", "h", "kind"), rows)


def anchors_geojson(report: PlacementReport, answer: PlacementAnswer) -> str:
    """A FeatureCollection of Points in WGS84 (RFC 7946), their grid coordinates beside; needs a frame with a datum.

    The third coordinate is the grid's height, not that above the ellipsoid: `height` says which.
    """
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": lon_lat_h},
            "properties": properties,
        }
        for lon_lat_h, properties in zip(wgs84(report, answer), anchor_facts(report, answer), strict=True)
    ]
    return json_text({"type": "FeatureCollection", "features": features})


def wgs84(report: PlacementReport, answer: PlacementAnswer) -> list[list[float]]:
    """Longitude, latitude (degrees, to 0.1 mm) and grid height of the chosen anchors."""
    found = report.frame.to_wgs84(answer.chosen.point_m)
    return np.column_stack([np.round(found[:, :2], 9), np.round(found[:, 2], 4)]).tolist()


def anchor_facts(report: PlacementReport, answer: PlacementAnswer) -> list[dict[str, Any]]:
    """What a map viewer shows of every anchor."""
    chosen, frame, passed = answer.chosen, report.frame, visits_by_anchor(answer.chosen)
    grid = np.round(frame.to_grid(chosen.point_m), _DIGITS)
    return [
        {
            "name": name,
            "kind": kind(report, stands),
            **dict(zip("ENh", point.tolist(), strict=True)),
            "crs": frame.crs,
            "height": frame.height,
            "passed_at_m": np.round(passed[name], 1),
            "plan": report.name,
            "simulated": report.simulated,
        }
        for name, stands, point in zip(chosen.name, chosen.standing, grid, strict=True)
    ]


def kind(report: PlacementReport, stands: bool) -> str:
    """`planned`, `standing` or `given`."""
    return "given" if report.predicted else "standing" if stands else "planned"
