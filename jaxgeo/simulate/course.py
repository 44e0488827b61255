"""The true course of a layout: worked out once and shared by all of its sessions."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from jaxgeo.simulate.layout import LOCATIONS, SURVEYED_ENH_M, Layout
from jaxgeo.simulate.walk import Walk, walk_past


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """What an odometry is asked to measure.

    Attributes:
        walk: the body pose at any time.
        stamp_s: (n,) of the trajectories' poses, from 0.
        pose: (n) `T_local_body` at those.
        step: (n-1) motion from each pose to the next, in the frame of the earlier.
        length_m, turn_rad: (n-1,) of the steps.
        distance_m: (n,) along the path.
        visit_pose: (k,) the pose nearest to the middle of each visit.
        arrive_m, leave_m: (k,) along the path, where each visit begins and ends.
    """

    walk: Walk
    stamp_s: Float[np.ndarray, "n"]
    pose: RigidTransform
    step: RigidTransform
    length_m: Float[np.ndarray, "m"]
    turn_rad: Float[np.ndarray, "m"]
    distance_m: Float[np.ndarray, "n"]
    visit_pose: Int[np.ndarray, "k"]
    arrive_m: Float[np.ndarray, "k"]
    leave_m: Float[np.ndarray, "k"]


@functools.lru_cache(maxsize=16)
def course_of(layout: Layout) -> Course:
    """The walk past the layout's markers. It is laid past where they were surveyed: the same for all seeds."""
    walk = walk_past(SURVEYED_ENH_M[[LOCATIONS.index(name) for name in layout.order]], layout)
    return course_along(walk, np.linspace(0.0, layout.duration_s, layout.n_poses))


def course_along(walk: Walk, stamp_s: Float[np.ndarray, "n"]) -> Course:
    """The course with poses at these stamps; its arrays are read-only, being shared."""
    pose = walk.pose(stamp_s)
    step = pose[:-1].inv() * pose[1:]
    length_m = np.linalg.norm(step.translation, axis=1)
    turn_rad = step.rotation.magnitude()
    distance_m = np.concatenate([[0.0], np.cumsum(length_m)])
    middle_s = 0.5 * (walk.arrive_s + walk.leave_s)
    visit_pose = np.abs(stamp_s[:, None] - middle_s).argmin(axis=0)
    arrive_m, leave_m = (np.interp(at_s, stamp_s, distance_m) for at_s in (walk.arrive_s, walk.leave_s))
    for array in (stamp_s, length_m, turn_rad, distance_m, visit_pose, arrive_m, leave_m):
        array.flags.writeable = False
    return Course(walk, stamp_s, pose, step, length_m, turn_rad, distance_m, visit_pose, arrive_m, leave_m)
