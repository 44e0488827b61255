"""Surveys: from a delimited table, or from points written in the config."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from jaxgeo.data import Survey
from jaxgeo.errors import SurveyError
from jaxgeo.io.column_roles import Columns, column_roles
from jaxgeo.io.survey_points import GRID_ROLES, Sigma, build_survey, checked_crs, survey_roles
from jaxgeo.io.text_table import TextTable, float_columns, read_table, text_column


def read_survey(
    path: str | Path,
    *,
    crs: str | None,
    columns: Columns | None = None,
    delimiter: str | None = None,
    sigma_m: Sigma | None = None,
    sigma_floor_m: Sigma | None = None,
    height_m: float | None = None,
    ignore: Sequence[str | int] = (),
) -> Survey:
    """Read a survey: `name, N, E, h` in any order, with `sigma_N, sigma_E, sigma_h` or `sigma_m`, metres.

    Which number is northing and which easting is decided by the columns' names alone: their sizes do not tell. The
    marker's rotation may stand in `rx, ry, rz` (rotation vector of T_grid_marker about the E, N, h axes, radians),
    its standard deviations in `sigma_rx, sigma_ry, sigma_rz`; where these are not given they are NaN. Columns
    `x, y, z` mean E, N, h, in a `local` frame only.

    Args:
        path: the table.
        crs: `EPSG:<code>`, `EPSG:<horizontal>+<vertical>` or `local`; there is no default.
        columns: role -> header name or 0-based index; only what it names is read. Default: by header.
        delimiter: one character; default: guessed.
        sigma_m: standard deviation where the file gives none; one number or [E, N, h].
        sigma_floor_m: smaller standard deviations are raised to it; one number or [E, N, h].
        height_m: height of points that have none (2-D survey).
        ignore: names not to be used.

    Raises:
        SurveyError: with file and line.
    """
    try:
        crs = checked_crs(crs)
    except SurveyError as failure:
        raise SurveyError(f"{path}: {failure}") from None
    table = read_table(path, delimiter=delimiter, error=SurveyError)
    roles = _roles(table, columns, crs)
    numeric = {role: index for role, index in roles.items() if role != "name"}
    values = float_columns(table, list(numeric.values()), blank_is_nan=True)
    return build_survey(
        [table.place(row) for row in range(len(table))],
        text_column(table, roles["name"]),
        dict(zip(numeric, values.T, strict=True)),
        crs=crs,
        sigma_m=sigma_m,
        sigma_floor_m=sigma_floor_m,
        height_m=height_m,
        ignore=ignore,
    )


def survey_from_points(
    points: Mapping[str | int, Mapping[str, float]],
    *,
    crs: str | None,
    sigma_m: Sigma | None = None,
    sigma_floor_m: Sigma | None = None,
    height_m: float | None = None,
    ignore: Sequence[str | int] = (),
) -> Survey:
    """The survey of points written out: `{A: {N: .., E: .., h: ..}}`, keys and further arguments as in `read_survey`.

    Raises:
        SurveyError: with the point's name.
    """
    crs = checked_crs(crs)
    role_of = {name: role for role, names in survey_roles(crs).items() for name in names if role != "name"}
    fields = {role: np.full(len(points), np.nan) for role in GRID_ROLES if role != "name"}
    for row, (name, point) in enumerate(points.items()):
        if not isinstance(point, Mapping):
            raise SurveyError(
                f"survey point {name!r}: {point!r}; expected named coordinates {{N: .., E: .., h: ..}}: a bare list "
                "does not tell northing from easting."
            )
        for key, value in point.items():
            role = role_of.get(key.casefold())
            if role is None:
                raise SurveyError(f"survey point {name!r}: unknown key {key!r}, expected N, E, h and sigma_N ...")
            if not math.isnan(fields[role][row]):
                raise SurveyError(f"survey point {name!r}: {role} is given twice, the second time as {key!r}.")
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise SurveyError(f"survey point {name!r}: {key} is {value!r}, expected a finite number.")
            fields[role][row] = value
    return build_survey(
        [f"survey point {name!r}" for name in points],
        [str(name) for name in points],
        fields,
        crs=crs,
        sigma_m=sigma_m,
        sigma_floor_m=sigma_floor_m,
        height_m=height_m,
        ignore=ignore,
    )


def _roles(table: TextTable, columns: Columns | None, crs: str) -> dict[str, int]:
    """Columns by role; h is not required here, since a 2-D survey has none."""
    names = {name.casefold() for name in (table.header if columns is None else columns)}
    if crs != "local" and names & {"x", "y"} and not names & {"e", "easting"}:
        raise SurveyError(
            f"{table.path}: columns x, y do not tell northing from easting in {crs}; name them N and E (in the "
            "header or in `columns`), or set crs: local for a site frame."
        )
    roles = column_roles(table, columns, survey_roles(crs), ("name", "E", "N"))
    stray = [
        name
        for index, name in enumerate(table.header)
        if columns is None and name.casefold().startswith(("sigma", "std")) and index not in roles.values()
    ]
    if stray:
        raise SurveyError(
            f"{table.path}: column {stray[0]!r} looks like a standard deviation but is not known; expected sigma_N, "
            "sigma_E, sigma_h or sigma_m, in metres."
        )
    return roles
