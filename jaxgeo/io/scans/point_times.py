"""When each point of a scan was measured: the drivers' ways of saying it, brought to seconds after the scan's stamp."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Num

from jaxgeo.io.scans.scan_source import UnreadableScanError

TIME_NAMES = ("t", "time", "timestamp", "offset_time", "time_stamp", "point_times")
SHORTEST_SWEEP_S = 1e-3
LONGEST_SWEEP_S = 2.0
SMALLEST_EPOCH_NS = 1e17  # the year 1973
LARGEST_NS = 9e18  # of what 64 bits hold


def point_time_s(
    columns: Mapping[str, Num[np.ndarray, "n"]], stamp_s: float, source: str
) -> Float[np.ndarray, "n"] | None:
    """Each point's time minus the scan's stamp, seconds; None where no column holds times, or all are the same.

    The column is the first of `TIME_NAMES` that is there, whatever its case. Its unit follows from type and size:

    | type              | meaning                                                                                |
    |-------------------|----------------------------------------------------------------------------------------|
    | integers          | nanoseconds: after the stamp (Ouster, Livox), or, of 64 bits, also of the stamp's clock |
    | float32           | seconds after the stamp (Velodyne)                                                     |
    | float64           | seconds after the stamp, or of the stamp's clock (Hesai, RoboSense)                    |
    | float64 from 1e17 | nanoseconds of the stamp's clock (Livox)                                               |

    Of two readings the one counts whose sweep lies nearer to the stamp. The outcome must be plausible: a sweep of 1 ms
    to 2 s, within 2 s of the stamp. That refuses other units and other clocks rather than guessing at them:
    microseconds read as nanoseconds last 0.1 ms.

    Raises:
        UnreadableScanError: the times are not plausible.
    """
    name = _time_column(columns)
    if name is None or not len(columns[name]):
        return None
    values = columns[name]
    lowest, highest = values.min(), values.max()
    place = f"{source}: point times {name!r} ({values.dtype.name})"
    if not (np.isfinite(lowest) and np.isfinite(highest)) or max(abs(float(lowest)), abs(float(highest))) > LARGEST_NS:
        raise UnreadableScanError(
            f"{place} run from {lowest} to {highest}, expected seconds or nanoseconds. {_way_out(name)}"
        )
    if lowest == highest:
        return None
    time_s, meaning = _after_stamp(values, stamp_s)
    sweep_s = float(time_s.max() - time_s.min())
    if not SHORTEST_SWEEP_S <= sweep_s <= LONGEST_SWEEP_S:
        raise UnreadableScanError(
            f"{place} run from {lowest} to {highest}: taken as {meaning}, a sweep of {sweep_s:.3g} s, expected "
            f"{SHORTEST_SWEEP_S:g} to {LONGEST_SWEEP_S:g} s. Are they in another unit? {_way_out(name)}"
        )
    if np.abs(time_s).max() > LONGEST_SWEEP_S:
        raise UnreadableScanError(
            f"{place} run from {lowest} to {highest}: taken as {meaning}, they lie {time_s.min():.6g} to "
            f"{time_s.max():.6g} s after the scan's stamp {stamp_s!r}, expected within {LONGEST_SWEEP_S:g} s. Are "
            f"stamp and points of different clocks? {_way_out(name)}"
        )
    return time_s


def _time_column(columns: Mapping[str, Num[np.ndarray, "n"]]) -> str | None:
    """The column that holds times; None where there is none."""
    by_name = {name.casefold(): name for name in columns}
    return next((by_name[name] for name in TIME_NAMES if name in by_name), None)


def _after_stamp(values: Num[np.ndarray, "n"], stamp_s: float) -> tuple[Float[np.ndarray, "n"], str]:
    """Seconds after the stamp, and what the values were taken for."""
    whole = np.issubdtype(values.dtype, np.integer)
    nanoseconds = whole or float(values.min()) >= SMALLEST_EPOCH_NS
    unit = "nanoseconds" if nanoseconds else "seconds"
    after_s = values.astype(np.float64) / (1e9 if nanoseconds else 1.0)
    if values.dtype.itemsize == 8:
        # Nanoseconds as whole numbers: as float64 those of today are 256 apart
        of_clock_s = (values.astype(np.int64) - round(stamp_s * 1e9)) / 1e9 if nanoseconds else after_s - stamp_s
        # Offsets need not begin at exactly 0, which matters where the clock itself begins at 0
        if _away_s(of_clock_s) < _away_s(after_s) - 0.1 * np.ptp(after_s):
            return of_clock_s, f"{unit} of the stamp's clock"
    return after_s, f"{unit} after the stamp"


def _away_s(time_s: Float[np.ndarray, "n"]) -> float:
    """How far a sweep lies from the stamp: 0 where it begins before and ends after it."""
    return max(0.0, time_s.min(), -time_s.max())


def _way_out(name: str) -> str:
    return f"Mend {name!r} in the recording, or read the scans without point times (point_times=False)."
