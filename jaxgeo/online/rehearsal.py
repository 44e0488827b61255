"""A made-up walk through the very programs that a session will need, so that they are compiled before it."""

import dataclasses

import numpy as np

from jaxgeo.data import Sightings, Survey, Trajectory
from jaxgeo.geometry.interpolate import poses_at

# A visit of up to this many sightings finds its programs compiled.
MOST_SIGHTINGS = 1024
_SIDE_M = 10.0


@dataclasses.dataclass(frozen=True)
class Rehearsal:
    """Poses round a square, a marker of its own seen from each, and where the markers were surveyed."""

    trajectory: Trajectory
    sightings: Sightings
    survey: Survey


def rehearsal(gap_s: float, origin_enh_m: np.ndarray, crs: str) -> Rehearsal:
    """Five poses and markers; each visit ends before the next begins."""
    corners = _SIDE_M * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [1.0, 1.0, 0.0], [0.0, 1.0, 0.2], [0.5, 0.5, 0.0]])
    n = len(corners)
    names = tuple(f"rehearsal{i}" for i in range(n))
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    stamp_s = np.arange(n) * max(2.0 * gap_s, 1.0)
    sightings = Sightings(
        stamp_s=stamp_s,
        marker=np.array(names),
        t_body_marker_m=np.zeros((n, 3)),
        quat_body_marker_wxyz=upright,
        covariance=np.tile(1e-4 * np.eye(6), (n, 1, 1)),
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array(names),
    )
    sigma = np.full((n, 3), 0.01)
    survey = Survey(names, corners + origin_enh_m, sigma, upright, sigma, crs)
    return Rehearsal(Trajectory(stamp_s, corners, upright), sightings, survey)


def rehearse_interpolation(trajectory: Trajectory) -> None:
    """Poses between poses, for visits of every size: sizes are rounded up to powers of two."""
    count = 1
    while count <= MOST_SIGHTINGS:
        poses_at(trajectory, np.full(count, trajectory.stamp_s[0]))
        count *= 2
