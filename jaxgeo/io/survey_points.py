"""From the fields of surveyed points to a `Survey`: the checks that files and inline points share."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Survey
from jaxgeo.errors import SurveyError
from jaxgeo.io.checks import LARGEST_POSITION_M

GRID_ROLES = {
    "name": ("name", "id", "location", "point"),
    "E": ("e", "easting"),
    "N": ("n", "northing"),
    "h": ("h", "height", "up"),
    "rx": ("rx",),
    "ry": ("ry",),
    "rz": ("rz",),
    "sigma_m": ("sigma_m",),
    "sigma_E": ("sigma_e",),
    "sigma_N": ("sigma_n",),
    "sigma_h": ("sigma_h",),
    "sigma_rx": ("sigma_rx",),
    "sigma_ry": ("sigma_ry",),
    "sigma_rz": ("sigma_rz",),
}
_LOCAL_NAMES = {"E": "x", "N": "y", "h": "z", "sigma_E": "sigma_x", "sigma_N": "sigma_y", "sigma_h": "sigma_z"}
LOCAL_ROLES = {role: (*names, *filter(None, [_LOCAL_NAMES.get(role)])) for role, names in GRID_ROLES.items()}

Sigma = float | Sequence[float]
"""Metres: one for all axes, or [E, N, h]."""


def checked_crs(crs: str | None) -> str:
    """`local`, or `EPSG:<code>`, or `EPSG:<horizontal>+<vertical>`.

    Raises:
        SurveyError: it is missing or of another form.
    """
    form = "expected EPSG:<code>, EPSG:<horizontal>+<vertical> (such as EPSG:2169+5773), or local (a site frame)"
    if not crs:
        raise SurveyError(f"the survey's coordinate system is missing: give `crs:` in the config; {form}.")
    if crs.casefold() == "local":
        return "local"
    if not re.fullmatch(r"EPSG:\d+(\+\d+)?", crs.upper()):
        raise SurveyError(f"crs: {crs!r}; {form}.")
    return crs.upper()


def survey_roles(crs: str) -> Mapping[str, tuple[str, ...]]:
    """What a survey's columns may be called: x, y, z only in a site frame, since grids disagree on which is which."""
    return LOCAL_ROLES if crs == "local" else GRID_ROLES


def build_survey(
    places: Sequence[str],
    names: Sequence[str],
    fields: Mapping[str, Float[np.ndarray, "n"]],
    *,
    crs: str,
    sigma_m: Sigma | None = None,
    sigma_floor_m: Sigma | None = None,
    height_m: float | None = None,
    ignore: Sequence[str | int] = (),
) -> Survey:
    """The survey of these points.

    Args:
        places: (n) where each point stands, for messages.
        names: (n) names.
        fields: by role of `survey_roles`; NaN where a point lacks it.
        crs: as in `Survey`.
        sigma_m: for axes without a sigma of their own.
        sigma_floor_m: smaller sigmas are raised to it.
        height_m: for points without a height.
        ignore: names to leave out, unchecked; a name that is not there is none (an id may be seen but not surveyed).

    Raises:
        SurveyError: with place: names empty or repeated, coordinates or sigmas missing or out of range.
    """
    crs = checked_crs(crs)
    keep = _kept_rows(places, names, ignore)
    places, names = [places[i] for i in keep], [names[i] for i in keep]
    fields = {role: values[keep] for role, values in fields.items()}
    _check_names(places, names)
    enh_m = _coordinates(places, names, fields, height_m)
    quat_wxyz, sigma_rot_rad = _rotations(places, names, fields)
    return Survey(
        name=tuple(names),
        enh_m=enh_m,
        sigma_m=_sigmas(places, names, fields, sigma_m, sigma_floor_m),
        quat_grid_marker_wxyz=quat_wxyz,
        sigma_rot_rad=sigma_rot_rad,
        crs=crs,
    )


def _kept_rows(places: Sequence[str], names: Sequence[str], ignore: Sequence[str | int]) -> list[int]:
    ignored = {str(name) for name in ignore}
    keep = [i for i, name in enumerate(names) if name not in ignored]
    if not keep:
        where = f"{places[0]}: " if places else ""
        raise SurveyError(f"{where}the survey has no locations{' left after `ignore`' if ignored else ''}.")
    return keep


def _check_names(places: Sequence[str], names: Sequence[str]) -> None:
    first: dict[str, str] = {}
    for place, name in zip(places, names, strict=True):
        if not name:
            raise SurveyError(f"{place}: the location has no name.")
        if name in first:
            raise SurveyError(
                f"{place}: location {name!r} is already given at {first[name]}; expected unique names. Average or "
                "rename them."
            )
        first[name] = place


def _field(fields: Mapping[str, np.ndarray], role: str, n: int) -> Float[np.ndarray, "n"]:
    return fields.get(role, np.full(n, np.nan))


def _coordinates(
    places: Sequence[str], names: Sequence[str], fields: Mapping[str, np.ndarray], height_m: float | None
) -> Float[np.ndarray, "n 3"]:
    enh_m = np.column_stack([_field(fields, role, len(names)) for role in ("E", "N", "h")])
    if height_m is not None:
        enh_m[np.isnan(enh_m[:, 2]), 2] = height_m
    for place, name, point in zip(places, names, enh_m, strict=True):
        known = [axis for axis, value in zip(("E", "N", "h"), point, strict=True) if not np.isnan(value)]
        if len(known) < 3:
            mend = "For a 2-D survey set `height_m`" if known == ["E", "N"] else "Add the missing one"
            raise SurveyError(
                f"{place}: location {name!r} has {len(known)} coordinate(s) ({', '.join(known)}); expected N, E, h in "
                f"metres. {mend}."
            )
        largest = point[np.argmax(np.abs(point))]
        if not abs(largest) <= LARGEST_POSITION_M:
            raise SurveyError(
                f"{place}: location {name!r} has the coordinate {largest:.9g} m, beyond {LARGEST_POSITION_M:g} m. "
                "Are the units metres and the columns right?"
            )
    return enh_m


def _three(sigma: Sigma, name: str) -> Float[np.ndarray, "3"]:
    values = np.asarray(sigma, dtype=float)
    if values.shape not in ((), (3,)) or not (np.isfinite(values) & (values > 0)).all():
        raise SurveyError(f"{name}: {sigma}; expected one positive number of metres, or three: [E, N, h].")
    return np.broadcast_to(values, 3)


def _sigmas(
    places: Sequence[str],
    names: Sequence[str],
    fields: Mapping[str, np.ndarray],
    sigma_m: Sigma | None,
    sigma_floor_m: Sigma | None,
) -> Float[np.ndarray, "n 3"]:
    n = len(names)
    sigmas = np.column_stack([_field(fields, role, n) for role in ("sigma_E", "sigma_N", "sigma_h")])
    sigmas = np.where(np.isnan(sigmas), _field(fields, "sigma_m", n)[:, None], sigmas)
    if sigma_m is not None:
        sigmas = np.where(np.isnan(sigmas), _three(sigma_m, "sigma_m"), sigmas)
    for place, name, row in zip(places, names, sigmas, strict=True):
        if np.isnan(row).any():
            axis = ("E", "N", "h")[int(np.argmax(np.isnan(row)))]
            raise SurveyError(
                f"{place}: location {name!r} has no standard deviation in {axis}; add columns sigma_N, sigma_E, "
                "sigma_h, or set `sigma_m`, in metres."
            )
        if not ((row > 0) & (row <= LARGEST_POSITION_M)).all():
            odd = row.min() if row.min() <= 0 else row.max()
            raise SurveyError(
                f"{place}: location {name!r} has the standard deviation {odd:g} m; expected a positive number, at most "
                f"{LARGEST_POSITION_M:g}."
            )
    return sigmas if sigma_floor_m is None else np.maximum(sigmas, _three(sigma_floor_m, "sigma_floor_m"))


def _rotations(
    places: Sequence[str], names: Sequence[str], fields: Mapping[str, np.ndarray]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
    """Marker rotations from rotation vectors about the (E, N, h) axes, and their sigmas."""
    n = len(names)
    rotvec = np.column_stack([_field(fields, role, n) for role in ("rx", "ry", "rz")])
    sigma = np.column_stack([_field(fields, role, n) for role in ("sigma_rx", "sigma_ry", "sigma_rz")])
    count = (~np.isnan(rotvec)).sum(axis=1)
    half = (count > 0) & (count < 3)
    if half.any():
        row = int(np.argmax(half))
        raise SurveyError(
            f"{places[row]}: location {names[row]!r}: rx, ry, rz are given in part; expected all or none."
        )
    known = count == 3
    bad = known & (sigma <= 0).any(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise SurveyError(
            f"{places[row]}: location {names[row]!r} has a rotation standard deviation of {sigma[row].min():g} rad; "
            "expected a positive number."
        )
    quat_wxyz = np.full((n, 4), np.nan)
    if known.any():
        quat_wxyz[known] = Rotation.from_rotvec(rotvec[known]).as_quat(scalar_first=True)
    return quat_wxyz, np.where(known[:, None], sigma, np.nan)
