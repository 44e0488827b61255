"""The path of a trajectory as columns of numbers, thinned: what the interactive figures show of every pose."""

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.export.figure_style import distance_along_m, thin
from jaxgeo.export.interactive import MAX_POINTS
from jaxgeo.export.number_words import THIN
from jaxgeo.export.result import SessionResult, TrajectoryResult

Columns = dict[str, Float[np.ndarray, "m"]]
# Stamp and time, then every axis with its sigma, in the order of POSE_HOVER's columns.
POSE_COLUMNS = ("time_s", "distance_m", "E", "sigma_E", "N", "sigma_N", "h", "sigma_h", "stamp_s")
POSE_HOVER = (
    "%{customdata[0]:,.2f} s after the start, %{customdata[1]:,.2f} m along the path<br>"
    "E %{customdata[2]:,.3f} ± %{customdata[3]:.3f} m<br>"
    "N %{customdata[4]:,.3f} ± %{customdata[5]:.3f} m<br>"
    "h %{customdata[6]:,.3f} ± %{customdata[7]:.3f} m<br>"
    "stamp %{customdata[8]:.3f} s"
)


def shown_rows(trajectory: TrajectoryResult) -> Int[np.ndarray, "m"]:
    """The poses that are shown: evenly spaced, and every one that carries an anchor."""
    rows = thin(len(trajectory.corrected), MAX_POINTS)
    return np.union1d(rows, trajectory.anchors.pose_index).astype(int)


def path_columns(result: SessionResult, trajectory: TrajectoryResult) -> Columns:
    """Of every shown pose: stamp, time since the start, length of the path, grid coordinates and their sigmas.

    Grid coordinates to the millimetre: a browser has float64, so nothing is lost by adding the origin here.
    """
    rows = shown_rows(trajectory)
    stamp_s = trajectory.corrected.stamp_s
    sigma_m = np.sqrt(np.diagonal(trajectory.covariance[rows], axis1=1, axis2=2)[:, :3])
    grid_m = result.frame.to_grid(trajectory.corrected.position_m[rows])
    columns = {
        "stamp_s": stamp_s[rows],
        "time_s": stamp_s[rows] - stamp_s[0],
        "distance_m": distance_along_m(trajectory.corrected.position_m)[rows],
    }
    columns |= {axis: grid_m[:, i] for i, axis in enumerate("ENh")}
    columns |= {f"sigma_{axis}": sigma_m[:, i] for i, axis in enumerate("ENh")}
    return {name: values.round(4 if name.startswith("sigma") else 3) for name, values in columns.items()}


def group_name(result: SessionResult, trajectory: TrajectoryResult) -> str:
    """Figures of one trajectory point at the same pose; those of another on the same page do not."""
    return f"{result.name}/{trajectory.name}"


def thinning_words(trajectory: TrajectoryResult) -> str:
    """How many poses are shown, where not all are."""
    n, shown = len(trajectory.corrected), len(shown_rows(trajectory))
    if shown == n:
        return ""
    return f" Shown are {shown:,} of {n:,} poses.".replace(",", THIN)
