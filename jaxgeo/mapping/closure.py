"""A loop closure: two keyframes far apart along the path that were seen to be near each other."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

ClosureKind = Literal["lidar", "rgbd"]


@dataclasses.dataclass(frozen=True)
class Closure:
    """The measured motion between two keyframes.

    Attributes:
        first, second: rows of the keyframes, first < second.
        T_first_second: (4, 4) of the body frames.
        information: (6, 6) of `Log(measured^-1 T_first^-1 T_second)`, (translation, rotation), m and rad.
        score: share of the points or features that agree, 0 .. 1.
        kind: the sensor that saw it.
    """

    first: int
    second: int
    T_first_second: Float[np.ndarray, "4 4"]
    information: Float[np.ndarray, "6 6"]
    score: float
    kind: ClosureKind
