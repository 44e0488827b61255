"""Keyframes: the few poses of a trajectory that stand for all of it in the map."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.geometry import poses_at
from jaxgeo.geometry.rigid import matrices


@dataclasses.dataclass(frozen=True)
class Keyframes:
    """Poses `T_map_body` chosen from those at the stamps of scans or frames.

    Attributes:
        stamp_s: (k,) strictly increasing.
        T_map_body: (k, 4, 4).
        source: (k,) rows of the stamps they were chosen from.
    """

    stamp_s: Float[np.ndarray, "k"]
    T_map_body: Float[np.ndarray, "k 4 4"]
    source: Int[np.ndarray, "k"]

    def __len__(self) -> int:
        return len(self.stamp_s)


def choose_keyframes(
    trajectory: Trajectory, stamps: Float[np.ndarray, "m"], distance_m: float, angle_rad: float
) -> Keyframes:
    """The first stamp, then each one whose pose is this far or this turned from the keyframe before it.

    The rule looks only backwards: between a keyframe and the next the body stays near the former.

    Args:
        stamps: strictly increasing, inside the trajectory; the poses there are interpolated on SE(3).

    Raises:
        SightingError: a stamp outside the trajectory (`jaxgeo.geometry.poses_at`).
    """
    poses = poses_at(trajectory, stamps)
    position_m = poses.position_m
    attitude = Rotation.from_quat(poses.quat_wxyz, scalar_first=True)
    chosen = [0]
    for k in range(1, len(stamps)):
        last = chosen[-1]
        far = np.linalg.norm(position_m[k] - position_m[last]) >= distance_m
        if far or (attitude[last].inv() * attitude[k]).magnitude() >= angle_rad:
            chosen.append(k)
    rows = np.array(chosen)
    return Keyframes(np.asarray(stamps)[rows], matrices(position_m[rows], poses.quat_wxyz[rows]), rows)
