"""Laser scans as RTAB-Map stores them: a compressed matrix of float32 points, and beside it what its channels are.

`scan_info` is, in float32: since version 0.18 format, least range, largest range, three angles, most points, local
transform (12); before, most points, largest range, [format,] local transform. The local transform is `T_body_scanner`.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import ScanError
from jaxgeo.io.pose_matrices import check_poses
from jaxgeo.io.rtabmap.blobs import compressed_array, numbers

# Number of a format: its name, and the channels after the coordinates
_FORMATS = {
    1: ("XY", ()),
    2: ("XYI", ("i",)),
    3: ("XYNormal", ("n",) * 3),
    4: ("XYINormal", ("i", *("n",) * 3)),
    5: ("XYZ", ()),
    6: ("XYZI", ("i",)),
    7: ("XYZRGB", ("rgb",)),
    8: ("XYZNormal", ("n",) * 3),
    9: ("XYZINormal", ("i", *("n",) * 3)),
    10: ("XYZRGBNormal", ("rgb", *("n",) * 3)),
    11: ("XYZIT", ("i", "t")),
}
_OF_CHANNELS = {2: 1, 3: 5, 4: 7, 5: 3, 6: 8, 7: 10}  # format 0, of old databases: told by the number of channels
_LONGEST_SCAN_S = 10.0


@dataclasses.dataclass(frozen=True)
class ScanInfo:
    """What the channels of a scan are.

    Attributes:
        format: RTAB-Map's number; 0: told by the number of channels.
        T_body_scanner: (3, 4).
    """

    format: int
    T_body_scanner: Float[np.ndarray, "3 4"]


@dataclasses.dataclass(frozen=True)
class ScanPoints:
    """One scan, in the body frame.

    Attributes:
        points_m: (n, 3) finite.
        time_s: (n,) after the node's stamp; None where there are no times.
        intensity: (n,), or None.
        n_empty: points that were dropped: returns of nothing, at the scanner itself or not finite.
    """

    points_m: Float[np.ndarray, "n 3"]
    time_s: Float[np.ndarray, "n"] | None
    intensity: Float[np.ndarray, "n"] | None
    n_empty: int


def scan_info(data: bytes | None, version: tuple[int, ...], place: str) -> ScanInfo:
    """What `scan_info` says.

    Raises:
        ScanError: there is none, it has another size, an unknown format, or the local transform is no pose.
        InputError: cut off.
    """
    if data is None:
        raise ScanError(f"{place}: no scan_info: what the scan holds and where the scanner sits is not known.")
    if version >= (0, 18):
        values, at, format_at = numbers(data, "<f4", 19, place), 7, 0
    elif len(data) == 60:
        values, at, format_at = numbers(data, "<f4", 15, place), 3, 2
    else:
        values, at, format_at = numbers(data, "<f4", 14, place), 2, None
    format = 0.0 if format_at is None else values[format_at]
    if format not in (0, *_FORMATS):
        known = ", ".join(f"{number} {name}" for number, (name, _) in _FORMATS.items())
        raise ScanError(f"{place}: scan format {format:g} is not known; expected one of {known}.")
    pose = values[at:].reshape(3, 4)
    check_poses(pose[None], lambda _: f"{place}: local transform", ScanError)
    return ScanInfo(int(format), pose)


def scan_points(data: bytes, info: ScanInfo, place: str) -> ScanPoints:
    """The points of a scan.

    Raises:
        ScanError: channels that do not fit the format, or times that are no times within a scan.
        InputError: the value is cut off or damaged.
    """
    matrix = compressed_array(data, place)
    rows = matrix.reshape(-1, matrix.shape[2]) if matrix.ndim == 3 else matrix
    number = info.format or _OF_CHANNELS.get(rows.shape[1], 0)
    if number == 0:
        raise ScanError(f"{place}: {rows.shape[1]} channels and no format; expected 2 to 7.")
    name, others = _FORMATS[number]
    flat = number < 5
    n_axes = 2 if flat else 3
    if rows.dtype != np.float32 or rows.shape[1] != n_axes + len(others):
        raise ScanError(
            f"{place}: {rows.shape[1]} channels of {rows.dtype}; the format {name} has {n_axes + len(others)} of "
            "float32. Is the value damaged?"
        )
    with np.errstate(invalid="ignore"):  # NaN of the signalling kind: dropped below, as every other
        values = rows.astype(np.float64)
    full = np.isfinite(values[:, :n_axes]).all(axis=1) & values[:, :n_axes].any(axis=1)
    values = values[full]
    points_m = np.column_stack([values[:, :n_axes], np.zeros((len(values), 3 - n_axes))])
    columns = {channel: values[:, n_axes + i] for i, channel in enumerate(others) if channel in "it"}
    time_s = columns.get("t")
    if time_s is not None and not (np.abs(time_s) <= _LONGEST_SCAN_S).all():
        raise ScanError(
            f"{place}: point times up to {np.abs(time_s).max():g} s; expected seconds after the scan's stamp, at most "
            f"{_LONGEST_SCAN_S:g}."
        )
    pose = info.T_body_scanner
    return ScanPoints(points_m @ pose[:, :3].T + pose[:, 3], time_s, columns.get("i"), int((~full).sum()))
