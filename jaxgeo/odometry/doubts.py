"""Where an odometry is to be doubted, in words."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from jaxgeo.odometry.tracked import Tracked

# No vehicle and no hand does more than this between two scans, beside the noise of the poses themselves
ACCELERATION_M_S2, ACCELERATION_RAD_S2 = 10.0, 30.0
NOISE_M, NOISE_RAD = 0.15, 0.1
LISTED = 5


def doubts(stamp_s: Float[np.ndarray, "n"], tracked: Sequence[Tracked]) -> tuple[str, ...]:
    """Sentences about scans that were lost, moved as nothing moves, did not converge, or hold too few directions."""
    lost = np.array([t.lost for t in tracked])
    share = np.array([t.inlier_share for t in tracked])
    words = _listed(
        [
            f"{_stretch(stamp_s, run)} lost: down to {100 * share[run].min():.0f} % of the points found the map. The "
            "poses there are guesses."
            for run in _runs(lost)
        ],
        "lost",
    )
    deviation_m = np.array([t.deviation_m for t in tracked])
    deviation_rad = np.array([t.deviation_rad for t in tracked])
    dt2 = np.square(np.diff(stamp_s, prepend=stamp_s[0]))
    wild = (deviation_m > NOISE_M + ACCELERATION_M_S2 * dt2) | (deviation_rad > NOISE_RAD + ACCELERATION_RAD_S2 * dt2)
    words += _listed(
        [
            f"{_stretch(stamp_s, run)} off the motion before by up to {deviation_m[run].max():.2f} m and "
            f"{np.degrees(deviation_rad[run].max()):.0f} deg, more than a body can do in that time. Wrong matches, or "
            "wrong stamps?"
            for run in _runs(wild & ~lost)
        ],
        "off the motion before",
    )
    stuck = np.array([not t.converged for t in tracked]) & ~lost
    words += _counted(stamp_s, stuck, "were not settled when the iterations ran out")
    weak = np.array([t.held < 1.0 for t in tracked]) & ~lost
    words += _counted(
        stamp_s, weak, "are not held in every direction (a tunnel, a single wall): there the motion before them decided"
    )
    return tuple(words)


def _listed(stretches: list[str], what: str) -> list[str]:
    more = len(stretches) - LISTED
    return stretches[:LISTED] + ([f"{more} more stretches of scans were {what}."] if more > 0 else [])


def _counted(stamp_s: Float[np.ndarray, "n"], flags: Bool[np.ndarray, "n"], what: str) -> list[str]:
    where = np.flatnonzero(flags)
    if not len(where):
        return []
    first, last = float(stamp_s[where[0]]), float(stamp_s[where[-1]])
    return [f"{len(where)} of {len(flags)} scans {what}; the first at {first!r} s, the last at {last!r} s."]


def _runs(flags: Bool[np.ndarray, "n"]) -> list[slice]:
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist()]


def _stretch(stamp_s: Float[np.ndarray, "n"], run: slice) -> str:
    n = run.stop - run.start
    if n == 1:
        return f"the scan of {float(stamp_s[run.start])!r} s was"
    return f"{n} scans from {float(stamp_s[run.start])!r} s to {float(stamp_s[run.stop - 1])!r} s were"
