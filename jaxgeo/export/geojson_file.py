"""trajectory.geojson: the corrected path and its anchors in WGS84, for a map viewer (RFC 7946: longitude, latitude)."""

from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.export.held_out_stats import final_stage
from jaxgeo.export.json_text import json_text
from jaxgeo.export.result import SessionResult, TrajectoryResult

NO_DATUM = "the session's coordinates are local: without a datum there is no longitude and latitude"


def geojson_text(result: SessionResult, name: str) -> str:
    """A FeatureCollection: one LineString of the path, one Point an anchor at its surveyed position.

    Only for a frame with a datum. Longitude and latitude are rounded to 1e-9 degrees (0.1 mm), heights to 0.1 mm.
    Heights are those of the grid, not above the WGS84 ellipsoid as RFC 7946 has it: `height` says which.
    """
    trajectory = result.trajectories[name]
    path = {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": wgs84(result, trajectory.corrected.position_m)},
        "properties": {
            "kind": "trajectory",
            "name": name,
            "session": result.name,
            "simulated": result.simulated,
            "n_poses": len(trajectory.corrected),
            "start_stamp_s": trajectory.corrected.stamp_s[0],
            "end_stamp_s": trajectory.corrected.stamp_s[-1],
            "crs": result.frame.crs,
            "origin_enh_m": result.frame.origin_enh_m,
            "height": result.frame.height,
            "wgs84_operation": result.frame.operation,
            "wgs84_accuracy_m": result.frame.operation_accuracy_m,
        },
    }
    points = zip(wgs84(result, trajectory.anchors.surveyed_enh_m), anchor_properties(result, trajectory), strict=True)
    anchors = [{"type": "Feature", "geometry": {"type": "Point", "coordinates": c}, "properties": p} for c, p in points]
    return json_text({"type": "FeatureCollection", "features": [path, *anchors]}, indent=None)


def wgs84(result: SessionResult, position_m: Float[np.ndarray, "n 3"]) -> list[list[float]]:
    """Longitude, latitude (degrees) and grid height (m) of local positions."""
    lon_lat_h = result.frame.to_wgs84(position_m)
    return np.column_stack([np.round(lon_lat_h[:, :2], 9), np.round(lon_lat_h[:, 2], 4)]).tolist()


def anchor_properties(result: SessionResult, trajectory: TrajectoryResult) -> list[dict[str, Any]]:
    """What a map viewer shows of every anchor."""
    anchors = trajectory.anchors
    held_out = trajectory.held_out.get(final_stage(trajectory))
    errors = held_out.error_enh_m if held_out else np.full((len(anchors), 3), np.nan)
    return [
        {
            "kind": "anchor",
            "label": anchors.label[j],
            "location": anchors.location[j],
            "stamp_s": anchors.stamp_s[j],
            "count": anchors.count[j],
            "residual_coarse_m": np.linalg.norm(trajectory.residual_coarse_m[j]),
            "residual_refined_m": np.linalg.norm(trajectory.residual_refined_m[j]),
            "held_out_m": np.linalg.norm(errors[j]),
            "simulated": result.simulated,
        }
        for j in range(len(anchors))
    ]
