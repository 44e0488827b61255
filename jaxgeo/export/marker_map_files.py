"""A marker map as files: table of markers, image poses (TUM), numbers (JSON), picture."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxgeo.data import Rig
from jaxgeo.export.csv_text import csv_text
from jaxgeo.export.json_text import json_text
from jaxgeo.export.marker_map_plot import marker_map_figure, save_png
from jaxgeo.io.atomic import output_folder
from jaxgeo.io.sighting_covariance import COVARIANCE
from jaxgeo.solve.marker_map import MarkerMap

_COLUMNS = ("name", "x", "y", "z", "qw", "qx", "qy", "qz", "images", "reprojection_rms_px", *COVARIANCE)


def write_marker_map(folder: str | Path, found: MarkerMap, rig: Rig, side_m: float) -> None:
    """Write marker_map.csv, image_poses.tum, marker_map.json and marker_map.png, all or none.

    Raises:
        InputError: the folder cannot be written to.
    """
    with output_folder(folder) as temporary:
        (temporary / "marker_map.csv").write_text(marker_table(found), encoding="utf-8")
        (temporary / "image_poses.tum").write_text(image_poses(found), encoding="utf-8")
        (temporary / "marker_map.json").write_text(json_text(map_numbers(found, rig, side_m)), encoding="utf-8")
        save_png(marker_map_figure(found, side_m), temporary / "marker_map.png")


def marker_table(found: MarkerMap) -> str:
    """Poses T_map_marker, metres, with the upper triangle of their covariance as in `Sightings`."""
    row, column = np.triu_indices(6)
    error_px = found.corner_error_px
    rows = []
    for m, name in enumerate(found.marker):
        own = found.sighting_marker == m
        rms_px = float(np.sqrt(np.mean(error_px[own] ** 2)))
        pose = [*found.position_m[m].tolist(), *found.quat_wxyz[m].tolist()]
        rows.append([str(name), *pose, int(own.sum()), rms_px, *found.covariance[m][row, column].tolist()])
    comments = ["jaxgeo marker map: poses T_map_marker, metres", f"the frame is marker {found.origin}"]
    return csv_text(comments, _COLUMNS, rows)


def image_poses(found: MarkerMap) -> str:
    """`stamp x y z qx qy qz qw` of the body in the map frame, a line for each image."""
    table = np.column_stack([found.stamp_s, found.image_position_m, found.image_quat_wxyz[:, [1, 2, 3, 0]]])
    return "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist())


def map_numbers(found: MarkerMap, rig: Rig, side_m: float) -> dict[str, Any]:
    """What the command prints, and the residuals by marker and by image."""
    error_px = found.corner_error_px
    return {
        "origin": found.origin,
        "side_m": side_m,
        "markers": len(found.marker),
        "images": len(found.stamp_s),
        "sightings": len(found.weight),
        "reprojection_median_px": float(np.median(error_px)),
        "reprojection_rms_px": _rms(error_px),
        "reprojection_worst_px": float(error_px.max()),
        "sigma_factor": found.sigma_factor,
        "chi2": found.chi2,
        "dof": found.dof,
        "cost": found.cost,
        "steps": found.steps,
        "outliers": [
            {
                "source": str(found.source[s]),
                "marker": str(found.marker[found.sighting_marker[s]]),
                "stamp_s": float(found.stamp_s[found.sighting_image[s]]),
                "rms_px": _rms(error_px[s]),
                "weight": float(found.weight[s]),
            }
            for s in found.outliers.tolist()
        ],
        "by_marker": {
            str(name): {
                "images": int(np.count_nonzero(found.sighting_marker == m)),
                "rms_px": _rms(error_px[found.sighting_marker == m]),
                "sigma_m": np.sqrt(np.diagonal(found.covariance[m])[:3]),
                "sigma_rad": np.sqrt(np.diagonal(found.covariance[m])[3:]),
            }
            for m, name in enumerate(found.marker)
        },
        "by_image": [
            {"stamp_s": stamp, "markers": int(np.count_nonzero(own)), "rms_px": _rms(error_px[own])}
            for i, stamp in enumerate(found.stamp_s.tolist())
            for own in [found.sighting_image == i]
        ],
        "refined_camera": _refined(found, rig),
    }


def _rms(error_px: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error_px**2)))


def _refined(found: MarkerMap, rig: Rig) -> dict[str, Any] | None:
    """The camera after refinement, in the keys of a rig file."""
    if not np.any(found.camera_sigma):
        return None
    log_scale, cx, cy, k1, k2 = found.camera.tolist()
    name = found.camera_name
    camera = rig.cameras[name]
    fx, fy = (camera.intrinsics_px[:2] * np.exp(log_scale)).tolist()
    model = "equidistant" if camera.distortion_model == "equidistant" else "radtan"
    distortion = np.zeros(max(4, camera.distortion.size))
    distortion[: camera.distortion.size] = camera.distortion
    distortion[:2] += [k1, k2]
    sigma = found.camera_sigma
    return {
        "camera": name,
        "intrinsics_px": [fx, fy, camera.intrinsics_px[2] + cx, camera.intrinsics_px[3] + cy],
        "distortion_model": model,
        "distortion": distortion,
        "sigma": {"focal_relative": sigma[0], "cx_px": sigma[1], "cy_px": sigma[2], "k1": sigma[3], "k2": sigma[4]},
    }
