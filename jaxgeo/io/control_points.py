"""Control points: rows that say when the rig stood on which surveyed point."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Sightings, Survey
from jaxgeo.errors import SightingError
from jaxgeo.io.checks import check_increasing, check_seconds
from jaxgeo.io.column_roles import Columns, column_roles
from jaxgeo.io.sightings_csv import row_sources
from jaxgeo.io.survey_points import Sigma, build_survey, checked_crs, survey_roles
from jaxgeo.io.text_table import TextTable, float_columns, read_table, text_column

LARGEST_SPREAD_M = 0.05


def read_control_points(
    path: str | Path,
    *,
    crs: str | None,
    lever_arm_m: Sequence[float],
    sigma_m: Sigma,
    sighting_sigma_m: float,
    columns: Columns | None = None,
    delimiter: str | None = None,
    names: Sequence[str | int] | None = None,
) -> tuple[Survey, Sightings]:
    """Read control points: one row for each stop of the rig, `stamp_s, E, N, h`, sorted by stamp.

    Args:
        path: the table.
        crs: as in `read_survey`.
        lever_arm_m: (3,) of the surveyed mark in the body frame.
        sigma_m: standard deviation of the survey; one number or [E, N, h].
        sighting_sigma_m: standard deviation of each coordinate of the mark in the body frame.
        columns: role -> header name or 0-based index; default: by header.
        delimiter: one character; default: guessed.
        names: the rows' locations in file order; default: a column `name`, else P01, P02, ... Rows of one name are
            visits of one location, whose coordinates are their mean.

    Returns:
        The survey, and one position-only sighting for each row, its marker named as the location.

    Raises:
        SurveyError, SightingError: with file and line.
    """
    crs = checked_crs(crs)
    table = read_table(path, delimiter=delimiter, error=SightingError)
    roles = column_roles(table, columns, {"stamp_s": ("stamp_s",), **survey_roles(crs)}, ("stamp_s", "E", "N", "h"))
    values = float_columns(table, [roles[role] for role in ("stamp_s", "E", "N", "h")])
    stamp_s, enh_m = values[:, 0], values[:, 1:]
    check_seconds(path, table.line, stamp_s, SightingError)
    check_increasing(path, table.line, stamp_s, SightingError)
    location = np.array(_row_names(table, roles, names))
    unique = list(dict.fromkeys(location.tolist()))
    mean_enh_m = np.array([_mean_position(table, name, np.flatnonzero(location == name), enh_m) for name in unique])
    first = [int(np.argmax(location == name)) for name in unique]
    survey = build_survey(
        [table.place(row) for row in first],
        unique,
        dict(zip(("E", "N", "h"), mean_enh_m.T, strict=True)),
        crs=crs,
        sigma_m=sigma_m,
    )
    return survey, _sightings(table, stamp_s, location, lever_arm_m, sighting_sigma_m)


def _row_names(table: TextTable, roles: dict[str, int], names: Sequence[str | int] | None) -> list[str]:
    if names is None:
        if "name" in roles:
            return text_column(table, roles["name"])
        return [f"P{i:02d}" for i in range(1, len(table) + 1)]
    if "name" in roles:
        raise SightingError(f"{table.path}: the table has a name column and `names` are given; expected one of them.")
    if len(names) != len(table):
        raise SightingError(
            f"{table.path}: {len(table)} rows, but {len(names)} names; expected a name for each row, in file order."
        )
    return [str(name) for name in names]


def _mean_position(
    table: TextTable, name: str, rows: np.ndarray, enh_m: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "3"]:
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float64: refused below
        mean = enh_m[rows].mean(axis=0)
        distance = np.linalg.norm(enh_m[rows] - mean, axis=1)
    if not distance.max() <= LARGEST_SPREAD_M:
        lines = ", ".join(str(line) for line in table.line[rows])
        raise SightingError(
            f"{table.path}: location {name!r} (lines {lines}) spreads by {distance.max():.3f} m about its mean; "
            f"expected at most {LARGEST_SPREAD_M:g} m between visits of one point. Are the names right?"
        )
    return mean


def _sightings(
    table: TextTable,
    stamp_s: Float[np.ndarray, "n"],
    location: np.ndarray,
    lever_arm_m: Sequence[float],
    sighting_sigma_m: float,
) -> Sightings:
    lever = np.asarray(lever_arm_m, dtype=float)
    if lever.shape != (3,) or not np.isfinite(lever).all():
        raise SightingError(f"{table.path}: lever_arm_m is {lever_arm_m}, expected three numbers [x, y, z] in metres.")
    if not (np.isfinite(sighting_sigma_m) and sighting_sigma_m > 0):
        raise SightingError(
            f"{table.path}: sighting sigma is {sighting_sigma_m}, expected a positive number of metres."
        )
    n = len(table)
    return Sightings(
        stamp_s=stamp_s,
        marker=location,
        t_body_marker_m=np.tile(lever, (n, 1)),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=np.tile(np.diag([sighting_sigma_m**2] * 3 + [0.0] * 3), (n, 1, 1)),
        ambiguous=np.zeros(n, bool),
        reprojection_px=np.full(n, np.nan),
        source=row_sources(table),
    )
