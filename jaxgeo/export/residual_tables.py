"""Every anchor in the grid: where it was surveyed, and by how much the marker is missed, axis by axis."""

import numpy as np

from jaxgeo.export.held_out_stats import final_stage, normalised_squared_errors
from jaxgeo.export.metrics import pooled_repeatability_m
from jaxgeo.export.number_words import LengthColumn, decimal, grouped
from jaxgeo.export.report_page import table
from jaxgeo.export.result import SessionResult, TrajectoryResult

AXES = ("dE", "dN", "dh", "3-D")


def residual_table(result: SessionResult, trajectory: TrajectoryResult) -> str:
    """Every visit: surveyed grid coordinates to the millimetre, and the residuals with all anchors in."""
    anchors = trajectory.anchors
    surveyed_m = result.frame.to_grid(anchors.surveyed_enh_m)
    value = np.hstack([with_norm(x) for x in (trajectory.residual_coarse_m, trajectory.residual_refined_m)])
    show, spread = LengthColumn(value), LengthColumn(anchors.repeatability_m)
    rows = [
        [
            anchors.label[j],
            f"{anchors.count[j]}",
            spread(anchors.repeatability_m[j]),
            *(grouped(x, 3) for x in surveyed_m[j]),
            *map(show, value[j]),
        ]
        for j in range(len(anchors))
    ]
    pooled = pooled_repeatability_m(anchors.repeatability_m, anchors.count)
    return table(
        f"Surveyed markers, and predicted minus surveyed position with all anchors in, in {show.unit}",
        ["Visit", "n", f"spread {spread.unit}", "E", "N", "h", *AXES, *AXES],
        rows,
        groups=[("Sightings", 3), (f"Surveyed, {grid_words(result)}, m", 3), ("One-time similarity", 4), CORRECTED],
        footer=[["RMS", "", spread(pooled), "", "", "", *map(show, column_rms(value))]],
    )


CORRECTED = ("Corrected, all anchors in", 4)


def held_out_table(result: SessionResult, trajectory: TrajectoryResult) -> str:
    """Every visit in the fold that held its location out: prediction, error, what was predicted for it, their ratio."""
    anchors, held_out = trajectory.anchors, trajectory.held_out[final_stage(trajectory)]
    error_m, covariance_m2 = held_out.error_enh_m, held_out.covariance_m2
    predicted_m = result.frame.to_grid(anchors.surveyed_enh_m + error_m)
    sigma_m = np.sqrt(np.diagonal(covariance_m2, axis1=1, axis2=2))
    ratio = error_m / np.where(sigma_m > 0.0, sigma_m, np.nan)
    nees = normalised_squared_errors(error_m, covariance_m2)
    value = np.hstack([with_norm(error_m), sigma_m])
    show = LengthColumn(value)
    rows = [
        [
            anchors.label[j],
            *(grouped(x, 3) for x in predicted_m[j]),
            *map(show, value[j]),
            *(decimal(x, 1) for x in ratio[j]),
            decimal(nees[j], 1),
        ]
        for j in range(len(anchors))
    ]
    ratio_rms = [decimal(x, 1) for x in column_rms(ratio)]
    return table(
        f"Each marker as predicted with its location held out; error and one sigma in {show.unit}",
        ["Visit", "E", "N", "h", *AXES, "E", "N", "h", "E", "N", "h", "NEES"],
        rows,
        groups=[
            ("", 1),
            (f"Predicted, {grid_words(result)}, m", 3),
            ("Predicted minus surveyed", 4),
            ("1 sigma predicted", 3),
            ("Error over sigma", 4),
        ],
        footer=[["RMS", "", "", "", *map(show, column_rms(value)), *ratio_rms, ""]],
    )


def grid_words(result: SessionResult) -> str:
    """The coordinate system in a column's heading."""
    return result.frame.crs if result.frame.has_datum else "site frame"


def with_norm(error_m: np.ndarray) -> np.ndarray:
    """(k, 4): the axes and the length."""
    return np.column_stack([error_m, np.linalg.norm(error_m, axis=1)])


def column_rms(value: np.ndarray) -> np.ndarray:
    """RMS of every column over its finite values."""
    known = np.isfinite(value)
    count = known.sum(axis=0)
    square = np.where(known, value, 0.0) ** 2
    return np.sqrt(np.divide(square.sum(axis=0), count, out=np.full(value.shape[1], np.nan), where=count > 0))
