"""What is known of the robot's pose at this moment."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Anchors, Trajectory

Status = Literal["undetermined", "georeferenced", "stale"]


@dataclasses.dataclass(frozen=True)
class OnlinePose:
    """The newest pose, georeferenced where the anchors so far allow it.

    Attributes:
        stamp_s: of the last odometry pose.
        status: `georeferenced`; `undetermined`: the anchors do not fix the frame yet; `stale`: the last solve failed,
            and an older solution is carried on.
        words: why it is not georeferenced; empty where it is.
        position_m: (3,) body origin in the local frame; NaN where undetermined.
        enh_m: (3,) the same in the grid: easting, northing, height.
        quat_wxyz: (4,) body to grid axes.
        covariance: (6, 6), grid axes: position error added, rotation error multiplied on the left.
        n_anchors: visits in use.
        anchor_age_s: since the last visit in use; infinite where there is none.
    """

    stamp_s: float
    status: Status
    words: str
    position_m: Float[np.ndarray, "3"]
    enh_m: Float[np.ndarray, "3"]
    quat_wxyz: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "6 6"]
    n_anchors: int
    anchor_age_s: float


@dataclasses.dataclass(frozen=True)
class Update:
    """What an update did with the visits that had ended.

    Attributes:
        n_anchors: visits in use now.
        new: labels of the visits that are new, or were changed by late sightings.
        status, words: as in `OnlinePose`.
        steps: solver steps, or rounds under an ensemble; 0 where nothing was solved.
    """

    n_anchors: int
    new: tuple[str, ...]
    status: Status
    words: str
    steps: int


@dataclasses.dataclass(frozen=True)
class OnlineResult:
    """The whole trajectory so far, local frame, as the batch answer has it.

    Attributes:
        corrected: all poses.
        covariance: (n, 6, 6) of them.
        anchors: the visits in use.
        log_scale: of the odometry.
    """

    corrected: Trajectory
    covariance: Float[np.ndarray, "n 6 6"]
    anchors: Anchors
    log_scale: float
