"""anchors.csv: every visit with its surveyed point, its residuals, and its held-out error of every stage."""

import numpy as np

from jaxgeo.export.csv_text import csv_text, heading
from jaxgeo.export.held_out_stats import STAGES, stats_by_stage
from jaxgeo.export.result import SessionResult, TrajectoryResult


def anchors_text(result: SessionResult, name: str) -> str:
    """One row a visit. Errors are predicted minus surveyed marker position, metres; empty: does not exist."""
    columns = anchor_columns(result, result.trajectories[name])
    comments = [
        *heading(result, f"anchors of trajectory '{name}', one row a visit"),
        "errors are predicted minus surveyed marker position along E, N, h, metres",
        "coarse, refined: all anchors in; held_out_*: the visit's location left out of everything",
        "sigma_held_out_*: predicted standard deviation of that error; nees: its normalised square, 3 dof",
    ]
    return csv_text(comments, list(columns), zip(*columns.values(), strict=True))


def anchor_columns(result: SessionResult, trajectory: TrajectoryResult) -> dict[str, list]:
    """The table by column name."""
    anchors = trajectory.anchors
    columns: dict[str, list] = {
        "label": list(anchors.label),
        "location": list(anchors.location),
        "stamp_s": anchors.stamp_s.tolist(),
        "pose_index": anchors.pose_index.tolist(),
        "count": anchors.count.tolist(),
        "repeatability_m": anchors.repeatability_m.tolist(),
        **axes("surveyed_{}_m", result.frame.to_grid(anchors.surveyed_enh_m)),
        **axes("sigma_survey_{}_m", sigmas(anchors.survey_covariance_m2)),
        **error("coarse", trajectory.residual_coarse_m),
        **error("refined", trajectory.residual_refined_m),
    }
    stats = stats_by_stage(trajectory)
    missing = np.full((len(anchors), 3), np.nan)
    for stage in STAGES:
        held_out = trajectory.held_out.get(stage)
        columns |= error(f"held_out_{stage}", held_out.error_enh_m if held_out else missing)
        if stage != "coarse":
            sigma = sigmas(held_out.covariance_m2) if held_out else missing
            columns |= axes(f"sigma_held_out_{stage}_{{}}_m", sigma)
            columns[f"nees_{stage}"] = (stats[stage].nees if held_out else missing[:, 0]).tolist()
        columns[f"result_{stage}"] = list(held_out.result) if held_out else [None] * len(anchors)
    return columns


def error(stage: str, error_enh_m: np.ndarray) -> dict[str, list]:
    """Error columns of one stage: each axis and the length."""
    return axes(f"{stage}_d{{}}_m", error_enh_m) | {f"{stage}_norm_m": np.linalg.norm(error_enh_m, axis=1).tolist()}


def axes(pattern: str, value: np.ndarray) -> dict[str, list]:
    """Three columns, one an axis, named by the pattern."""
    return {pattern.format(axis): value[:, i].tolist() for i, axis in enumerate("ENh")}


def sigmas(covariance_m2: np.ndarray) -> np.ndarray:
    """(k, 3) standard deviations along the axes."""
    return np.sqrt(np.diagonal(covariance_m2, axis1=1, axis2=2))
