"""How far apart a trajectory, as it came, shows two visits of one place."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from jaxgeo.data import Sightings, Trajectory
from jaxgeo.simulate.session import SimulatedSession


def raw_revisit_gaps_m(session: SimulatedSession, name: str) -> dict[str, float]:
    """For every location visited more than once, its visits' largest distance in the trajectory's own map."""
    centre_m = visit_centres_m(session, session.trajectories[name])
    gaps = {}
    for location in dict.fromkeys(session.layout.order):
        visits = centre_m[[i for i, other in enumerate(session.layout.order) if other == location]]
        if len(visits) > 1:
            gaps[location] = float(np.linalg.norm(visits[:, None] - visits[None], axis=-1).max())
    return gaps


def visit_centres_m(session: SimulatedSession, trajectory: Trajectory) -> Float[np.ndarray, "k 3"]:
    """Mean marker position of every visit, composed in the trajectory's map; a time offset is taken out first."""
    composed_m = composed(trajectory, session.sightings, session.faults.time_offset_s)
    first = np.concatenate([[0], np.cumsum(session.layout.counts)[:-1]])
    return np.add.reduceat(composed_m, first) / np.array(session.layout.counts)[:, None]


def composed(trajectory: Trajectory, sightings: Sightings, late_s: float = 0.0) -> Float[np.ndarray, "n 3"]:
    """Every sighting's marker in the map, at the pose interpolated at its stamp minus `late_s`."""
    stamp_s = sightings.stamp_s - late_s
    attitude = Slerp(trajectory.stamp_s, Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True))(stamp_s)
    position_m = np.column_stack([np.interp(stamp_s, trajectory.stamp_s, axis) for axis in trajectory.position_m.T])
    return attitude.apply(sightings.t_body_marker_m) + position_m
