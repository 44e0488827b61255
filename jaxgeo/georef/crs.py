"""Coordinate reference systems: which EPSG codes can carry a survey, and their way to WGS84. pyproj lives here."""

import dataclasses
import functools
import math
import re
import warnings

import numpy as np
import pyproj
import pyproj.network
from jaxtyping import Float
from pyproj.exceptions import CRSError
from pyproj.transformer import AreaOfInterest, TransformerGroup

from jaxgeo.errors import SurveyError

LOCAL = "local"
_EPSG = re.compile(r"EPSG:\d+(\+\d+)?", re.IGNORECASE)
_EXAMPLES = "Examples: EPSG:2169 (LUREF), EPSG:9897 (LUREF with NG95 heights), EPSG:32632 (UTM 32N), or `local`."
_KM_PER_DEGREE = 111.2


@dataclasses.dataclass(frozen=True)
class GridCrs:
    """A projected CRS in metres, with or without a vertical one.

    Attributes:
        text: as given, `EPSG:<code>[+<code>]`.
        name: its name in the EPSG register.
        axis_order: axis names in the register's own order; coordinates here are always (E, N, h) whatever it says.
        height: name of the vertical CRS; empty where there is none.
        horizontal: the projected CRS alone.
        area_deg: west, south, east, north of its area of use.
    """

    text: str
    name: str
    axis_order: tuple[str, ...]
    height: str
    horizontal: pyproj.CRS
    area_deg: tuple[float, float, float, float]


@functools.lru_cache(maxsize=16)
def read_crs(text: str) -> GridCrs:
    """Look up an EPSG code that can carry a survey.

    Raises:
        SurveyError: unknown code; degrees; axes that are not metres, east, north and up.
    """
    shown = repr(str(text)[:80])
    if not isinstance(text, str) or not _EPSG.fullmatch(text.strip()):
        raise SurveyError(f"crs {shown} is not `EPSG:<code>`, `EPSG:<horizontal>+<vertical>` or `local`. {_EXAMPLES}")
    try:
        crs = pyproj.CRS.from_user_input(text.strip().upper())
    except CRSError as error:
        raise SurveyError(
            f"crs {shown} is not in the EPSG register of this pyproj ({str(error)[:120]}). {_EXAMPLES}"
        ) from error
    parts = crs.sub_crs_list if crs.is_compound else [crs]
    horizontal, vertical = parts[0], parts[1:]
    _check_horizontal(text, horizontal)
    for part in vertical:
        _check_axis(text, part.axis_info[0].name, part.axis_info[0], {"up"})
    area = horizontal.area_of_use
    bounds = (area.west, area.south, area.east, area.north) if area else (-180.0, -90.0, 180.0, 90.0)
    axes = tuple(axis.name for axis in crs.axis_info)
    return GridCrs(text, crs.name, axes, vertical[0].name if vertical else "", horizontal, bounds)


def _check_horizontal(text: str, crs: pyproj.CRS) -> None:
    if not crs.is_projected:
        raise SurveyError(
            f"crs {text!r} is {crs.name!r}, a {crs.type_name}; expected a projected CRS in metres, since distances are "
            f"not Euclidean in degrees. Project the survey first. {_EXAMPLES}"
        )
    for axis in crs.axis_info:
        _check_axis(text, axis.name, axis, {"east", "north"})
    if {axis.direction for axis in crs.axis_info} != {"east", "north"}:
        found = ", ".join(f"{axis.name} ({axis.direction})" for axis in crs.axis_info)
        raise SurveyError(
            f"crs {text!r} has the axes {found}; expected one east and one north. Use another projection."
        )


def _check_axis(text: str, name: str, axis, directions: set[str]) -> None:
    if axis.unit_conversion_factor != 1.0:
        raise SurveyError(
            f"crs {text!r}: axis {name!r} is in {axis.unit_name}; expected metres. "
            "Convert the survey to a CRS in metres."
        )
    if axis.direction not in directions:
        raise SurveyError(
            f"crs {text!r}: axis {name!r} points {axis.direction}; expected {' or '.join(sorted(directions))}. "
            "Convert the survey to another CRS."
        )


@functools.lru_cache(maxsize=16)
def wgs84_operation(crs: GridCrs, near_deg: tuple[float, float] | None = None) -> pyproj.Transformer:
    """The best operation from (E, N) to WGS84 (longitude, latitude) that works without the network.

    Horizontal only: PROJ answers a compound CRS whose height grid is not installed with a ballpark operation that drops
    the horizontal datum shift too (EPSG:9897: 112 m off), so heights are not given to it.

    Args:
        near_deg: longitude, latitude of the site: chooses among operations for different regions.
    """
    pyproj.network.set_network_enabled(False)  # pyright: ignore[reportPrivateImportUsage]
    area = None
    if near_deg is not None:
        lon, lat = near_deg
        area = AreaOfInterest(lon - 0.01, lat - 0.01, lon + 0.01, lat + 0.01)
    with warnings.catch_warnings():
        # A better operation whose grid file is not installed: its absence shows in the recorded accuracy.
        warnings.simplefilter("ignore", UserWarning)
        group = TransformerGroup(
            crs.horizontal, "EPSG:4326", always_xy=True, area_of_interest=area, allow_ballpark=False
        )
    if not group.transformers and near_deg is not None:  # outside every region: an origin may lie off the site
        return wgs84_operation(crs)
    if not group.transformers:
        raise SurveyError(
            f"crs {crs.text!r} ({crs.name}) has no operation to WGS84 without grid files from the network; "
            "use a CRS that has one, or `local`."
        )
    return group.transformers[0]


def grid_scale(crs: GridCrs, lon_deg: float, lat_deg: float) -> float:
    """Grid distance over ellipsoidal distance along the meridian."""
    return float(pyproj.Proj(crs.horizontal).get_factors(lon_deg, lat_deg).meridional_scale)


def km_outside(crs: GridCrs, lonlat_deg: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """How far outside the box of the area of use, roughly; infinite where the projection has no answer."""
    west, south, east, north = crs.area_deg
    lon, lat = lonlat_deg[:, 0], lonlat_deg[:, 1]
    finite = np.isfinite(lon) & np.isfinite(lat)
    lon, lat = np.where(finite, lon, 0.0), np.where(finite, lat, 0.0)
    half = 0.5 * ((east - west) % 360.0 if east != west + 360.0 else 360.0)
    from_centre = np.abs((lon - (west + half) + 180.0) % 360.0 - 180.0)
    d_lon = np.maximum(from_centre - half, 0.0) * np.cos(np.radians(np.clip(lat, -89.0, 89.0)))
    d_lat = np.maximum(np.maximum(south - lat, lat - north), 0.0)
    return np.where(finite, _KM_PER_DEGREE * np.hypot(d_lon, d_lat), math.inf)
