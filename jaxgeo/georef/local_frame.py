"""The frame in which everything is estimated: grid coordinates minus an origin.

In grid coordinates a step of float32 is 8 mm (LUREF) to half a metre (UTM northings), and products of coordinates lose
digits even in float64. The origin is subtracted once at ingest and added once at export. Order is always (E, N, h),
whatever the EPSG register says (EPSG:2169 is northing first): readers choose columns by name. LUREF eastings and
northings are of one size, so an exchange of the two cannot be seen in the numbers; in UTM it can, and `check` says so.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import SurveyError
from jaxgeo.georef.crs import LOCAL, GridCrs, grid_scale, km_outside, read_crs, wgs84_operation

_MARGIN_KM = 200.0
_LARGEST_M = 1e8
_LARGEST_SCALE_ERROR = 0.01  # UTM at the edge of its zone: 0.001; web Mercator (EPSG:3857) at 50 degrees: 0.55


@dataclasses.dataclass(frozen=True, eq=False)
class LocalFrame:
    """A grid and the origin subtracted from it. Make one with `LocalFrame.create`.

    Attributes:
        crs: `EPSG:<code>`, `EPSG:<horizontal>+<vertical>`, or `local`: a site frame without a datum.
        origin_enh_m: (3,) easting, northing, height of the local frame's zero.
        crs_name: in the EPSG register.
        axis_order: of the register; recorded only, never used.
        height: what h is: the vertical CRS, or that there is none. Heights are passed through to WGS84 output
            unchanged.
        operation, operation_accuracy_m: from the grid to WGS84 longitude and latitude; None where there is none or
            unknown.
        grid_scale: grid distance over ellipsoidal distance at the origin; None for `local`. Not applied: a fitted scale
            that differs from it is a fact about the odometry.
    """

    crs: str
    origin_enh_m: Float[np.ndarray, "3"]
    crs_name: str
    axis_order: tuple[str, ...]
    height: str
    operation: str | None
    operation_accuracy_m: float | None
    grid_scale: float | None

    @classmethod
    def create(cls, crs: str, origin_enh_m: Float[np.ndarray, "3"]) -> Self:
        """Look the CRS up and refuse an origin that cannot lie in it.

        Raises:
            SurveyError: unknown or unsuitable CRS; origin not three finite numbers, or far outside the area of use.
        """
        origin = np.asarray(origin_enh_m, dtype=np.float64)
        if origin.shape != (3,):
            raise SurveyError(
                f"origin_enh_m has shape {origin.shape}; expected three numbers: easting, northing, height."
            )
        if crs == LOCAL:
            frame = cls(crs, origin, "site frame without a datum", ("E", "N", "h"), "site height", None, None, None)
            frame.check(origin[None], ["origin_enh_m"])
            return frame
        grid = read_crs(crs)
        height = grid.height or "no vertical CRS given: heights as surveyed"
        lonlat = _lonlat(grid, origin[None, :2])
        check_in_area(grid, origin[None], ["origin_enh_m"])
        lon, lat = map(float, lonlat[0])
        scale = grid_scale(grid, lon, lat)
        if abs(scale - 1.0) > _LARGEST_SCALE_ERROR:
            raise SurveyError(
                f"crs {crs!r} ({grid.name}): at the origin {scale:.4f} grid metres stand for one metre; expected 1 "
                f"within {_LARGEST_SCALE_ERROR:.0%}. Use the region's national grid or UTM zone."
            )
        operation = wgs84_operation(grid, (lon, lat))
        accuracy_m = operation.accuracy if operation.accuracy is not None and operation.accuracy >= 0.0 else None
        return cls(crs, origin, grid.name, grid.axis_order, height, operation.description, accuracy_m, scale)

    def to_local(self, enh_m: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Grid to local: exact for an integer origin between half and twice the coordinate (Sterbenz)."""
        return np.asarray(enh_m, dtype=np.float64) - self.origin_enh_m

    def to_grid(self, local_m: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Local to grid (E, N, h)."""
        return np.asarray(local_m, dtype=np.float64) + self.origin_enh_m

    @property
    def has_datum(self) -> bool:
        """Whether `to_wgs84` has an answer."""
        return self.crs != LOCAL

    def to_wgs84(self, local_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Local to longitude and latitude in degrees; the third column is the grid height, unchanged.

        Raises:
            SurveyError: the frame is `local`.
        """
        return self.grid_to_wgs84(self.to_grid(local_m))

    def grid_to_wgs84(self, enh_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Grid (E, N, h) to longitude, latitude and grid height; raises as `to_wgs84`."""
        if not self.has_datum:
            raise SurveyError(
                "crs `local` has no datum, so its coordinates have no longitude and latitude; "
                "give the survey's EPSG code as `crs` for WGS84 output."
            )
        enh_m = np.asarray(enh_m, dtype=np.float64)
        grid = read_crs(self.crs)
        near = _lonlat(grid, self.origin_enh_m[None, :2])[0]
        return np.column_stack([_lonlat(grid, enh_m[:, :2], (float(near[0]), float(near[1]))), enh_m[:, 2]])

    def check(self, enh_m: Float[np.ndarray, "n 3"], names: Sequence[str]) -> None:
        """Refuse grid coordinates that cannot be what they claim.

        Raises:
            SurveyError: not finite, absurdly large, or more than 200 km outside the area where the CRS is used.
        """
        if self.has_datum:
            check_in_area(read_crs(self.crs), enh_m, names)
        else:
            _check_finite(enh_m, names)

    def as_dict(self) -> dict[str, Any]:
        """Everything recorded, JSON-ready: written into every output."""
        return dataclasses.asdict(self) | {
            "origin_enh_m": self.origin_enh_m.tolist(),
            "axis_order": list(self.axis_order),
        }


def default_origin(enh_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Component-wise median, rounded towards zero to 100 m.

    An integer, so that coordinates minus origin are exact in float64; towards zero, because the difference can only be
    inexact where the coordinate is less than half the origin.
    """
    return 100.0 * np.trunc(np.median(np.asarray(enh_m, dtype=np.float64), axis=0) / 100.0) + 0.0


def check_in_area(crs: GridCrs, enh_m: Float[np.ndarray, "n 3"], names: Sequence[str]) -> None:
    """Refuse coordinates far outside the CRS's area of use; raises as `LocalFrame.check`."""
    enh_m = np.asarray(enh_m, dtype=np.float64)
    _check_finite(enh_m, names)
    outside_km = km_outside(crs, _lonlat(crs, enh_m[:, :2]))
    bad = np.flatnonzero(outside_km > _MARGIN_KM)
    if bad.size == 0:
        return
    row = int(bad[0])
    easting, northing, _ = enh_m[row]
    how_far = f"{outside_km[row]:.0f} km outside" if np.isfinite(outside_km[row]) else "off the map of"
    exchanged = km_outside(crs, _lonlat(crs, enh_m[row : row + 1, 1::-1]))[0] == 0.0
    mend = (
        "With E and N exchanged it lies inside: the two columns are probably swapped."
        if exchanged
        else "Check the EPSG code, the unit (metres), the zone, and the order of E and N."
    )
    west, south, east, north = crs.area_deg
    raise SurveyError(
        f"{names[row]}: E {easting:.3f}, N {northing:.3f} lies {how_far} the area of {crs.text} ({crs.name}: "
        f"longitude {west} to {east}, latitude {south} to {north}). {mend}"
    )


def _check_finite(enh_m: Float[np.ndarray, "n 3"], names: Sequence[str]) -> None:
    enh_m = np.asarray(enh_m, dtype=np.float64)
    bad = np.flatnonzero(~(np.abs(enh_m) < _LARGEST_M).all(axis=1))
    if bad.size:
        row = int(bad[0])
        raise SurveyError(
            f"{names[row]}: coordinates E, N, h = {enh_m[row].tolist()}; expected finite metres below "
            f"{_LARGEST_M:.0e}. Check the unit (mm?) and the row."
        )


def _lonlat(
    crs: GridCrs, en_m: Float[np.ndarray, "n 2"], near_deg: tuple[float, float] | None = None
) -> Float[np.ndarray, "n 2"]:
    return np.column_stack(wgs84_operation(crs, near_deg).transform(en_m[:, 0], en_m[:, 1]))
