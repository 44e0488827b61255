"""Scans fit for odometry: enough points within the ranges asked for, in the order of their stamps."""

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np

from jaxgeo.data import Scan
from jaxgeo.errors import ScanError
from jaxgeo.odometry.settings import OdometrySettings

FEWEST_POINTS = 50  # ten neighbours make a covariance, and a pose has six unknowns


def checked_scans(scans: Iterable[Scan], settings: OdometrySettings) -> Iterator[Scan]:
    """The scans one by one, without the points outside `min_range_m` to `max_range_m`.

    Raises:
        ScanError: a stamp that is not a number or does not come after the one before, or fewer than 50 points.
    """
    before: Scan | None = None
    for scan in scans:
        if not np.isfinite(scan.stamp_s):
            raise ScanError(f"{scan.source}: its stamp is {scan.stamp_s}, expected seconds. Mend the stamps.")
        if before is not None and scan.stamp_s <= before.stamp_s:
            raise ScanError(
                f"{scan.source}: stamp {scan.stamp_s!r} s does not come after {before.stamp_s!r} s of the scan before "
                f"({before.source}). Scans must come in the order of time, each once: sort them, or mend the stamps."
            )
        before = scan
        yield _within_range(scan, settings)


def _within_range(scan: Scan, settings: OdometrySettings) -> Scan:
    low_m, high_m = settings.min_range_m or 0.0, settings.max_range_m or np.inf
    range_m = np.linalg.norm(scan.points_m, axis=1)
    keep = (range_m >= low_m) & (range_m <= high_m)
    n = int(keep.sum())
    if n < FEWEST_POINTS:
        limits = f" between {low_m:g} m and {high_m:g} m" if n < len(scan) else ""
        raise ScanError(
            f"{scan.source}: {n} points{limits}, of {len(scan)} in the scan; expected {FEWEST_POINTS} or more. "
            + ("Are the range limits right, and the points in metres?" if limits else "Leave this scan out.")
        )
    if n == len(scan):
        return scan
    return dataclasses.replace(
        scan,
        points_m=scan.points_m[keep],
        time_s=None if scan.time_s is None else scan.time_s[keep],
        intensity=None if scan.intensity is None else scan.intensity[keep],
    )
