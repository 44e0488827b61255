"""Stamps for formats that carry none: from a file of times, or from a rate."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import TrajectoryError
from jaxgeo.io.checks import check_increasing, check_seconds
from jaxgeo.io.text_table import float_columns, read_table


def row_stamps(path: str | Path, n: int, *, times: str | Path | None, rate_hz: float | None) -> Float[np.ndarray, "n"]:
    """Stamps of the n poses of `path`, in seconds.

    Args:
        path: the file of poses, for messages.
        n: its number of poses.
        times: file with one stamp in seconds a row.
        rate_hz: poses a second; the first pose gets stamp 0.

    Raises:
        TrajectoryError: neither or both are given, the counts differ, or the stamps do not increase.
    """
    if times is not None and rate_hz is None:
        return _stamps_of_file(path, n, times)
    if rate_hz is None or times is not None:
        given = "neither" if times is None else "both"
        raise TrajectoryError(
            f"{path}: this format carries no stamps, and {given} of `times` and `rate_hz` given; expected one of them: "
            "`times`, a file with one stamp in seconds a row, or `rate_hz`, poses a second."
        )
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise TrajectoryError(f"{path}: rate_hz is {rate_hz}, expected a positive number of poses a second.")
    return np.arange(n) / rate_hz


def _stamps_of_file(path: str | Path, n: int, times: str | Path) -> Float[np.ndarray, "n"]:
    table = read_table(times, error=TrajectoryError)
    if table.n_columns != 1:
        raise TrajectoryError(f"{table.place(0)}: {table.n_columns} columns, expected one stamp in seconds a row.")
    if len(table) != n:
        raise TrajectoryError(
            f"{path} has {n} poses, but {times} has {len(table)} stamps; expected one stamp for each pose. Is this the "
            "times file of another run?"
        )
    stamp_s = float_columns(table, [0])[:, 0]
    check_seconds(times, table.line, stamp_s, TrajectoryError)
    check_increasing(times, table.line, stamp_s, TrajectoryError)
    return stamp_s
