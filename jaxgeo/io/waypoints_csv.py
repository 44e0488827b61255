"""Planned paths: a table of corners, made a trajectory that follows the straight lines between them."""

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.io.checks import check_size
from jaxgeo.io.column_roles import Columns, column_roles
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.survey_points import checked_crs, survey_roles
from jaxgeo.io.text_table import TextTable, float_columns, read_table

# Poses along the whole path, beside its corners: finer steps foretell the same accuracy.
_STEPS = 1024
# Corners nearer together than this are one place.
_SAME_M = 1e-6


def read_waypoints(
    path: str | Path,
    *,
    crs: str,
    columns: Columns | None = None,
    delimiter: str | None = None,
    height_m: float | None = None,
    speed_m_s: float = 1.0,
) -> Trajectory:
    """Read the corners of a path, and follow them.

    Args:
        path: a table with columns N and E, and h unless `height_m` is given, in any order, metres; by name as in
            `read_survey`. Rows in the order of the path; other columns are not read.
        crs: as in `read_survey`.
        columns, delimiter: as in `read_survey`.
        height_m: of corners without a height.
        speed_m_s: of the whole path; the first pose has stamp 0.

    Returns:
        E, N, h of the grid; the body's x axis points along the way, its z axis up.

    Raises:
        TrajectoryError: with file and line: a column is missing, a cell is no number, no height, one corner only.
    """
    crs = checked_crs(crs)
    table = read_table(path, delimiter=delimiter, error=TrajectoryError)
    roles = {role: names for role, names in survey_roles(crs).items() if role in ("E", "N", "h")}
    found = column_roles(table, columns, roles, ("E", "N"))
    enh_m = np.full((len(table), 3), np.nan)
    named = [i for i, role in enumerate(("E", "N", "h")) if role in found]
    enh_m[:, named] = float_columns(table, [found[("E", "N", "h")[i]] for i in named], blank_is_nan=True)
    if height_m is not None:
        enh_m[np.isnan(enh_m[:, 2]), 2] = height_m
    _check_corners(table, enh_m)
    step_m = np.linalg.norm(np.diff(enh_m, axis=0), axis=1)
    kept = np.concatenate([[True], step_m > _SAME_M])
    if not kept.all():
        warnings.warn(
            f"{path}: {int((~kept).sum())} of {len(kept)} rows repeat the place of the row before; it counts once.",
            InputWarning,
            stacklevel=2,
        )
    if kept.sum() < 2:
        raise TrajectoryError(f"{path}: {int(kept.sum())} place(s); expected the two ends of a path or more.")
    return followed(enh_m[kept], speed_m_s)


def followed(corner_m: Float[np.ndarray, "c 3"], speed_m_s: float) -> Trajectory:
    """The trajectory along straight lines from corner to corner, no two the same, at one speed; it turns at corners.

    The heading is that of the line ahead; where this is vertical, the one before.
    """
    line_m = np.diff(corner_m, axis=0)
    length_m = np.linalg.norm(line_m, axis=1)
    parts = np.maximum(np.ceil(length_m / length_m.sum() * _STEPS), 1.0).astype(int)
    line = np.repeat(np.arange(len(parts)), parts)
    share = np.concatenate([np.arange(n) / n for n in parts])
    position_m = np.concatenate([corner_m[line] + share[:, None] * line_m[line], corner_m[-1:]])
    half_rad = 0.5 * _headings_rad(line_m)[np.append(line, len(parts) - 1)]
    quat_wxyz = np.zeros((len(half_rad), 4))
    quat_wxyz[:, 0], quat_wxyz[:, 3] = np.cos(half_rad), np.sin(half_rad)
    begin_m = np.concatenate([[0.0], np.cumsum(length_m)])
    way_m = np.append(begin_m[line] + share * length_m[line], begin_m[-1])
    return Trajectory(way_m / speed_m_s, position_m, quat_wxyz)


def _headings_rad(line_m: Float[np.ndarray, "l 3"]) -> Float[np.ndarray, "l"]:
    """Of every line, from east; of a vertical one, that of the last line before it, else of the first after it."""
    level = np.flatnonzero(np.linalg.norm(line_m[:, :2], axis=1) > _SAME_M)
    if not level.size:
        return np.zeros(len(line_m))
    last = np.searchsorted(level, np.arange(len(line_m)), side="right") - 1
    known = line_m[level[np.maximum(last, 0)]]
    return np.arctan2(known[:, 1], known[:, 0])


def _check_corners(table: TextTable, enh_m: Float[np.ndarray, "n 3"]) -> None:
    missing = np.isnan(enh_m)
    if missing.any():
        row, axis = np.argwhere(missing)[0]
        mend = " Give it one, or give `height_m`." if axis == 2 else ""
        raise TrajectoryError(f"{table.place(int(row))}: the corner has no {'ENh'[axis]}; expected metres.{mend}")
    check_size(table.path, table.line, enh_m, TrajectoryError)
