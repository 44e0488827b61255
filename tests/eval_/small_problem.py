"""A session of the shapes that many tests compile for: 200 poses, six locations, seven visits."""

import dataclasses

import numpy as np
from solve.chain_session import session, transforms

from calibration.calibrate import LearnSettings
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.solve.correct import Settings

LOCATIONS = ("A", "B", "C", "D", "E", "F", "A")
N_POSES = 200
SHIFT_M = np.array([100.0, -70.0, 40.0])
NOISE = default_noise("lidar")
SETTINGS = Settings()
LEARN = LearnSettings("lidar", NOISE)


def problem() -> tuple[Trajectory, Anchors]:
    made = session(N_POSES, len(LOCATIONS), lever_m=1.0, location=LOCATIONS)
    return made.trajectory, made.anchors


def shifted(anchors: Anchors, location: str, by_m: np.ndarray = SHIFT_M) -> Anchors:
    """One location surveyed elsewhere."""
    here = np.array([name == location for name in anchors.location])
    return dataclasses.replace(anchors, surveyed_enh_m=anchors.surveyed_enh_m + here[:, None] * by_m)


def three_on_a_line() -> tuple[Trajectory, Anchors]:
    """The same, but the marker of B was put on the middle of the line from C to D."""
    made = session(N_POSES, len(LOCATIONS), lever_m=1.0, location=LOCATIONS)
    _, b, c, d, *_ = range(len(LOCATIONS))
    surveyed, lever = made.anchors.surveyed_enh_m.copy(), made.anchors.lever_arm_m.copy()
    surveyed[b] = 0.5 * (surveyed[c] + surveyed[d])
    lever[b] = transforms(made.truth)[made.anchors.pose_index[b]].inv().apply(surveyed[b])
    return made.trajectory, dataclasses.replace(made.anchors, surveyed_enh_m=surveyed, lever_arm_m=lever)
