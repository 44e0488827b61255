"""metrics.json: the figures of one session."""

from typing import Any

import numpy as np

from jaxgeo.data import Anchors
from jaxgeo.export.held_out_stats import STAGES, HeldOutStats, stats_by_stage
from jaxgeo.export.json_text import json_ready
from jaxgeo.export.noise_file import noise_figures
from jaxgeo.export.result import HeldOut, ReferenceError, SessionResult, TrajectoryResult


def metrics_dict(result: SessionResult) -> dict[str, Any]:
    """All figures, JSON-ready. A stage that does not exist is None; lengths in metres, times in seconds."""
    seed, versions = result.config.get("seed"), result.run.get("versions", {})
    return json_ready(
        {
            "session": result.name,
            "simulated": result.simulated,
            "crs": result.frame.crs,
            "origin_enh_m": result.frame.origin_enh_m,
            "seed": seed,
            "versions": versions,
            "trajectories": {
                name: {**trajectory_metrics(t), "seed": seed, "versions": versions}
                for name, t in result.trajectories.items()
            },
        }
    )


def trajectory_metrics(trajectory: TrajectoryResult) -> dict[str, Any]:
    """The figures of one trajectory."""
    anchors = trajectory.anchors
    stats = stats_by_stage(trajectory)
    return {
        "n_poses": len(trajectory.corrected),
        "n_anchors": len(anchors),
        "n_visits": len(anchors),
        "n_locations": len(set(anchors.location)),
        "coarse": {"scale": trajectory.coarse.scale, "rms_m": trajectory.coarse.rms_m},
        "refined": {"rms_m": np.sqrt(np.mean(np.sum(trajectory.residual_refined_m**2, axis=1)))},
        "log_scale": {"value": trajectory.log_scale[0], "sigma": trajectory.log_scale[1]},
        "repeatability_rms_m": pooled_repeatability_m(anchors.repeatability_m, anchors.count),
        "revisit": trajectory.revisit,
        "loo": {
            stage: held_out_metrics(anchors, trajectory.held_out[stage], stats[stage]) if stage in stats else None
            for stage in STAGES
        },
        "reference": {
            stage: reference_metrics(trajectory.reference[stage]) if stage in trajectory.reference else None
            for stage in STAGES
        },
        "noise": noise_figures(trajectory.noise),
        "solver": trajectory.solver,
        "timing_s": trajectory.timing_s,
        "corrections": trajectory.corrections,
        "check": trajectory.check,
        "warnings": trajectory.warnings,
    }


def held_out_metrics(anchors: Anchors, held_out: HeldOut, stats: HeldOutStats) -> dict[str, Any]:
    """Held-out figures of one stage. `mean_m` and `rms_m` are over visits, `per_location` means over its visits."""
    label = anchors.label
    return {
        "mean_m": stats.mean_m,
        "rms_m": stats.rms_m,
        "mean_over_locations_m": stats.mean_over_locations_m,
        "per_location": stats.per_location_m,
        "per_visit": dict(zip(label, stats.norm_m, strict=True)),
        "n_failed": stats.n_failed,
        "result": dict(zip(label, held_out.result, strict=True)),
        "nees_3dof": {
            "mean_over_locations": stats.nees_mean,
            "mean_band_95": stats.nees_band,
            "per_visit": dict(zip(label, stats.nees, strict=True)),
        },
        "coverage_50": stats.coverage_50,
        "coverage_95": stats.coverage_95,
        "n_with_covariance": stats.n_covariance,
    }


def reference_metrics(reference: ReferenceError) -> dict[str, Any]:
    return {
        "ate_rmse_m": reference.ate_rmse_m,
        "ate_median_m": reference.ate_median_m,
        "n_poses": reference.n_poses,
    }


def pooled_repeatability_m(repeatability_m: np.ndarray, count: np.ndarray) -> float:
    """RMS over all sightings of all visits about their own visit's centroid."""
    return float(np.sqrt(np.sum(count * repeatability_m**2) / np.sum(count)))
