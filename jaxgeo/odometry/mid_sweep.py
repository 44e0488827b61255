"""Scans timed by the middle of their sweep, and the poses at their own stamps found again.

What a scan tells is the pose in the middle of its sweep: a wrong velocity, which straightens it wrongly, turns its two
halves to opposite sides. Straightened to the sweep's start instead, a velocity wrong by e moves the pose by e T / 2
over a sweep T, so that the next velocity is wrong by (e_before - e) / 2: an error that alternates and never dies out,
and grows where anything adds to it (measured: a spinning LiDAR at 5 Hz lost after 20 scans).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Scan
from jaxgeo.geometry.rigid import exp, inverse, log

GAP = 2.0  # times the interval on the other side: across it nobody keeps a velocity


def centred(scan: Scan) -> Scan:
    """The scan with its stamp in the middle of its points' times; as it is where they carry none."""
    if scan.time_s is None or not len(scan):
        return scan
    middle_s = 0.5 * float(scan.time_s.min() + scan.time_s.max())
    return dataclasses.replace(scan, stamp_s=scan.stamp_s + middle_s, time_s=scan.time_s - middle_s)


def poses_at_stamps(
    middle_s: Float[np.ndarray, "n"], T_map_lidar: Sequence[Float[np.ndarray, "4 4"]], stamp_s: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 4 4"]:
    """Poses at the stamps from those at the middles, along the screw motion between neighbours.

    The first pose is the identity again: the map frame is that of the first scan's stamp.
    """
    found = []
    for k, at_s in enumerate(stamp_s):
        if at_s == middle_s[k]:
            found.append(T_map_lidar[k])
            continue
        i = _interval(middle_s, k, at_s)
        step = log(inverse(T_map_lidar[i]) @ T_map_lidar[i + 1]) / (middle_s[i + 1] - middle_s[i])
        found.append(T_map_lidar[k] @ exp((at_s - middle_s[k]) * step))
    return inverse(found[0]) @ np.array(found)


def _interval(middle_s: Float[np.ndarray, "n"], k: int, at_s: float) -> int:
    """The interval whose velocity holds at a stamp near middle k: its own, unless that is a gap (twice the other)."""
    last = len(middle_s) - 2
    own, other = (k, k - 1) if at_s > middle_s[k] else (k - 1, k)
    own, other = min(max(own, 0), last), min(max(other, 0), last)
    length_s = np.diff(middle_s)
    return own if length_s[own] <= GAP * length_s[other] else other
