"""Packed scans: one `.npz` with many scans, unpacked once."""

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import Scan
from jaxgeo.errors import ScanError
from jaxgeo.io.checks import LARGEST_STAMP_S
from jaxgeo.io.item_source import OnBad
from jaxgeo.io.item_stamps import check_increasing_stamps, check_stamp_choice, listed_stamps, rate_stamps
from jaxgeo.io.scans.columns import scan_of_columns
from jaxgeo.io.scans.npz import check_columns, columns_of_points, load_arrays, points_of_arrays
from jaxgeo.io.scans.scan_source import ScanSource


class PackedScans(ScanSource):
    """The scans of one `.npz` file.

    Its arrays: `xyz` (rows of all scans; floats, or whole numbers times `scale` plus `offset`, metres), `offsets` (scan
    i is rows offsets[i] to offsets[i + 1]), and where there are any `times` (a stamp a scan, seconds), `intensity`,
    `point_times` (a number a point, see `point_time_s`). Other arrays are not looked at.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        stamps: str | Path | None = None,
        rate_hz: float | None = None,
        start_s: float | None = None,
        point_times: bool = True,
        on_bad: OnBad = "raise",
    ) -> None:
        """Unpack and check the file; its points stay in memory, quantised as they are.

        Args:
            path: the file.
            stamps: file of one stamp a line; default: the `times` in the file.
            rate_hz: scans a second, instead of these.
            start_s: stamp of the first scan with `rate_hz`; default 0.
            point_times: read the points' times, where there are any.
            on_bad: as of every source.

        Raises:
            ScanError: no such file, a damaged one, or one with pickled objects; arrays are missing or do not fit each
                other; no stamps, or stamps that do not increase.
        """
        self._path = Path(path)
        self._point_times = point_times
        check_stamp_choice(path, stamps, rate_hz, start_s)
        self._arrays = load_arrays(path, ScanError)
        self._xyz = points_of_arrays(self._arrays, str(path), ScanError)
        check_columns(self._arrays, len(self._xyz), str(path), ScanError)
        self._bounds = _bounds(path, self._arrays, len(self._xyz))
        n = len(self._bounds) - 1
        if rate_hz is not None:
            self._stamp_s = rate_stamps(n, rate_hz, start_s)
        elif stamps is not None:
            self._stamp_s = listed_stamps(path, n, stamps, "scan")[0]
        else:
            self._stamp_s = _times(path, self._arrays, n)
        super().__init__(n, on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Scan]]]:
        for index in range(start, len(self._stamp_s)):
            yield index, functools.partial(self._scan, index)

    def _scan(self, index: int) -> Scan:
        rows = slice(self._bounds[index], self._bounds[index + 1])
        columns = columns_of_points(self._xyz, self._arrays, rows)
        place = f"{self._path}:{index}"
        return scan_of_columns(columns, float(self._stamp_s[index]), place, index, point_times=self._point_times)

    def _name(self) -> str:
        return str(self._path)


def _bounds(path: str | Path, arrays: Mapping[str, np.ndarray], n_points: int) -> Int[np.ndarray, "n_plus_1"]:
    offsets = arrays.get("offsets")
    if offsets is None:
        raise ScanError(
            f"{path}: no array 'offsets' (the first row of each scan, and the number of rows). It holds "
            f"{', '.join(arrays)}. Of a single scan, name its folder."
        )
    if offsets.ndim != 1 or len(offsets) < 2 or offsets.dtype.kind not in "iu":
        raise ScanError(
            f"{path}: 'offsets' is {offsets.dtype} of shape {offsets.shape}, expected one whole "
            "number a scan and one more."
        )
    bounds = offsets.astype(np.int64)
    falls = np.diff(bounds) < 0
    if bounds[0] != 0 or bounds[-1] != n_points or falls.any():
        odd = f", falling after scan {int(np.argmax(falls))}" if falls.any() else ""
        raise ScanError(
            f"{path}: 'offsets' run from {bounds[0]} to {bounds[-1]}{odd}, expected from 0 to the {n_points} rows of "
            "'xyz'. Is the file cut off, or put together of two?"
        )
    return bounds


def _times(path: str | Path, arrays: Mapping[str, np.ndarray], n: int) -> Float[np.ndarray, "n"]:
    times = arrays.get("times")
    if times is None:
        raise ScanError(f"{path}: no array 'times' of stamps. Give `stamps` (one a line), or `rate_hz`.")
    if times.shape != (n,) or times.dtype.kind not in "iuf" or not np.isfinite(times).all():
        raise ScanError(
            f"{path}: 'times' is {times.dtype} of shape {times.shape}, expected {n} finite seconds, one for each scan."
        )
    if np.abs(times).max() > LARGEST_STAMP_S:
        raise ScanError(f"{path}: 'times' go up to {times.max()}, expected seconds. Nanoseconds? Divide by 1e9.")
    stamp_s = times.astype(np.float64)
    check_increasing_stamps(stamp_s, lambda row: f"{path}:{row}")
    return stamp_s
