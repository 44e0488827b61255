"""A scan out of the columns of any file or message."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Num

from jaxgeo.data import Scan
from jaxgeo.io.scans.point_times import point_time_s
from jaxgeo.io.scans.scan_source import UnreadableScanError

INTENSITY_NAMES = ("intensity", "i", "scalar_intensity", "reflectivity", "remission")
LARGEST_M = 1e5


def scan_of_columns(
    columns: Mapping[str, Num[np.ndarray, "n"]], stamp_s: float, source: str, index: int, *, point_times: bool = True
) -> Scan:
    """The scan of columns `x`, `y`, `z` in metres and, if there, times (`point_time_s`) and intensity.

    Points that are not finite and zeros (no return) are left out. Names match whatever their case.

    Raises:
        UnreadableScanError: a coordinate is missing or larger than 100 km, no point is left, or the times of the points
            are not plausible.
    """
    by_name = {name.casefold(): name for name in columns}
    missing = [name for name in "xyz" if name not in by_name]
    if missing:
        raise UnreadableScanError(
            f"{source}: no field {missing[0]!r}, expected x, y and z in metres. The fields are "
            f"{', '.join(columns) or 'none'}."
        )
    points_m = np.stack([_as_float64(columns[by_name[name]]) for name in "xyz"], axis=1)
    kept = np.asarray(np.isfinite(points_m).all(axis=1) & points_m.any(axis=1))
    if not kept.any():
        of = f"none of its {len(kept)} points is a return (zeros, or not finite)" if len(kept) else "it has no points"
        raise UnreadableScanError(f"{source}: the scan is empty: {of}. Is it of another sensor, or cut off?")
    points_m = points_m[kept]
    largest_m = np.abs(points_m).max()
    if largest_m > LARGEST_M:
        raise UnreadableScanError(
            f"{source}: a coordinate of size {largest_m:.6g}, expected metres in the sensor's frame, at most "
            f"{LARGEST_M:g}. Are they millimetres, or coordinates of a map or grid?"
        )
    rest = {name: values[kept] for name, values in columns.items()}
    intensity = next((rest[by_name[name]] for name in INTENSITY_NAMES if name in by_name), None)
    return Scan(
        stamp_s=stamp_s,
        points_m=points_m,
        time_s=point_time_s(rest, stamp_s, source) if point_times else None,
        intensity=None if intensity is None else _as_float64(intensity),
        source=source,
        index=index,
    )


def _as_float64(values: Num[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """The same numbers; NaN of the signalling kind, of which NumPy would warn, become quiet ones."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)
