"""Checks of rows that several readers share: stamps, rotations, sizes."""

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError, TrajectoryError
from jaxgeo.io.input_warning import RoundedInputWarning

LARGEST_POSITION_M = 1e8
LARGEST_STAMP_S = 1e11  # the year 5138: anything above is in other units
NORM_TOLERANCE = 1e-3  # three decimals
NORM_SILENT = 2e-6  # six decimals give up to 1e-6
NORM_EXACT = 1e-14  # a unit quaternion in float64: left bit for bit, so that a round trip changes nothing


def validated_trajectory(
    path: str | Path,
    lines: Int[np.ndarray, "n"],
    stamp_s: Float[np.ndarray, "n"],
    position_m: Float[np.ndarray, "n 3"],
    quat_wxyz: Float[np.ndarray, "n 4"],
) -> Trajectory:
    """The trajectory of these rows, after the checks that every reader owes.

    Rotations rounded to few decimals are brought back to unit length, with a `RoundedInputWarning`.

    Args:
        path: the file, for messages.
        lines: (n,) line of every row, for messages.
        stamp_s, position_m, quat_wxyz: as in `Trajectory`.

    Raises:
        TrajectoryError: fewer than two poses, numbers that are not finite or too large, stamps that do not increase,
            or quaternions that are not of unit length.
    """
    if len(stamp_s) < 2:
        raise TrajectoryError(f"{path}: {len(stamp_s)} pose(s), expected at least 2. Is the file complete?")
    check_finite(path, lines, np.column_stack([stamp_s, position_m, quat_wxyz]), TrajectoryError)
    check_seconds(path, lines, stamp_s, TrajectoryError)
    check_increasing(path, lines, stamp_s, TrajectoryError)
    check_size(path, lines, position_m, TrajectoryError)
    quat_wxyz = unit_quaternions(path, lines, quat_wxyz, TrajectoryError)
    return Trajectory(np.ascontiguousarray(stamp_s), np.ascontiguousarray(position_m), quat_wxyz)


def check_finite(
    path: str | Path, lines: Int[np.ndarray, "n"], values: Float[np.ndarray, "n m"], error: type[InputError]
) -> None:
    wrong = ~np.isfinite(values).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        bad = values[row][~np.isfinite(values[row])][0]
        raise error(f"{path}:{lines[row]}: holds {bad}; expected finite numbers. Remove or mend the row.")


def check_seconds(
    path: str | Path, lines: Int[np.ndarray, "n"], stamp_s: Float[np.ndarray, "n"], error: type[InputError]
) -> None:
    wrong = np.abs(stamp_s) > LARGEST_STAMP_S
    if wrong.any():
        row = int(np.argmax(wrong))
        raise error(
            f"{path}:{lines[row]}: stamp {stamp_s[row]:.9g} is not in seconds (larger than {LARGEST_STAMP_S:g}); "
            "nanoseconds? Divide the stamps by 1e9."
        )


def check_increasing(
    path: str | Path, lines: Int[np.ndarray, "n"], stamp_s: Float[np.ndarray, "n"], error: type[InputError]
) -> None:
    step = np.diff(stamp_s)
    if (step > 0).all():
        return
    row = int(np.argmax(step <= 0))
    before, after = float(stamp_s[row]), float(stamp_s[row + 1])
    if step[row] == 0:
        raise error(
            f"{path}:{lines[row + 1]}: stamp {after!r} repeats that of line {lines[row]}; expected strictly increasing "
            "stamps. Keep one of the two rows, or write the stamps with more decimals."
        )
    raise error(
        f"{path}:{lines[row + 1]}: stamp {after!r} lies before {before!r} of line {lines[row]}; expected strictly "
        "increasing stamps. Sort the rows by time, or cut a file of two runs in two."
    )


def check_size(
    path: str | Path, lines: Int[np.ndarray, "n"], position_m: Float[np.ndarray, "n 3"], error: type[InputError]
) -> None:
    wrong = (np.abs(position_m) > LARGEST_POSITION_M).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        value = position_m[row][np.argmax(np.abs(position_m[row]))]
        raise error(
            f"{path}:{lines[row]}: coordinate {value:.9g} m is beyond {LARGEST_POSITION_M:g} m. Are the units metres "
            "and the columns in order?"
        )


def unit_quaternions(
    path: str | Path, lines: Int[np.ndarray, "n"], quat_wxyz: Float[np.ndarray, "n 4"], error: type[InputError]
) -> Float[np.ndarray, "n 4"]:
    """Quaternions of unit length; rows of NaN (no rotation known) stay.

    Raises:
        error: a norm is off by more than 1e-3.
    """
    with np.errstate(over="ignore"):  # beyond float64: an infinite norm, refused below
        norm = np.linalg.norm(quat_wxyz, axis=1)
    off = np.abs(norm - 1.0)
    if (off > NORM_TOLERANCE).any():
        row = int(np.argmax(off > NORM_TOLERANCE))
        if norm[row] == 0:
            raise error(
                f"{path}:{lines[row]}: the quaternion is zero; expected unit length. Are the columns in another order, "
                "or was the pose not estimated? Then remove the row."
            )
        raise error(
            f"{path}:{lines[row]}: the quaternion has norm {norm[row]:.6g}, expected 1 within {NORM_TOLERANCE:g}. "
            "Are the columns in another order?"
        )
    if (off > NORM_SILENT).any():
        warnings.warn(
            f"{path}: quaternion norms are off by up to {np.nanmax(off):.1e}: the file was written with few decimals. "
            "They were brought back to unit length; write at least six decimals (at 100 m, four cost about 1 cm).",
            RoundedInputWarning,
            stacklevel=3,
        )
    return quat_wxyz / np.where(off <= NORM_EXACT, 1.0, norm)[:, None]
