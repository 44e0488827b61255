"""How far a cloud's points were moved apart: beside where one rigid transform would have put them."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.errors import CloudError
from jaxgeo.mapping.carry import PoseCorrections

_MOST_CHANGE = 0.5
_FARTHEST_M, _FARTHEST_EXTENTS = 5_000.0, 10.0


@dataclasses.dataclass(frozen=True)
class MeanCorrection:
    """The one rigid transform nearest to all poses' corrections: `rotation (scale p) + translation_m`."""

    rotation: Float[np.ndarray, "3 3"]
    translation_m: Float[np.ndarray, "3"]
    scale: float

    def apply(self, points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        return (self.scale * points_m) @ self.rotation.T + self.translation_m


@dataclasses.dataclass
class Extent:
    """Counts and distances of the points as they come, piece by piece.

    Attributes:
        n: points carried.
        sum_square_m2, largest_m: distances from where one rigid transform would have put them.
        n_twice, gap_square_m2, gap_m: by the nearest poses: points that another pass may have seen, sum of squares and
            largest of how far off that one would have put them.
    """

    n: int = 0
    sum_square_m2: float = 0.0
    largest_m: float = 0.0
    n_twice: int = 0
    gap_square_m2: float = 0.0
    gap_m: float = 0.0

    def add(self, carried_m: Float[np.ndarray, "n 3"], rigid_m: Float[np.ndarray, "n 3"]) -> None:
        square_m2 = np.sum((carried_m - rigid_m) ** 2, axis=1)
        self.n += len(square_m2)
        self.sum_square_m2 += float(square_m2.sum())
        self.largest_m = max(self.largest_m, float(np.sqrt(square_m2.max(initial=0.0))))

    def add_gaps(self, gap_m: Float[np.ndarray, "n"]) -> None:
        """Of the points alone that another pass may have seen."""
        self.n_twice += len(gap_m)
        self.gap_square_m2 += float(np.sum(gap_m**2))
        self.gap_m = max(self.gap_m, float(gap_m.max(initial=0.0)))

    @property
    def rms_m(self) -> float:
        return float(np.sqrt(self.sum_square_m2 / max(self.n, 1)))

    @property
    def gap_rms_m(self) -> float:
        return float(np.sqrt(self.gap_square_m2 / max(self.n_twice, 1)))


def mean_correction(corrections: PoseCorrections) -> MeanCorrection:
    """Chordal mean of the poses' rotations, and the translation that keeps their mean position."""
    before = Rotation.from_quat(corrections.before_wxyz, scalar_first=True)
    after = Rotation.from_quat(corrections.after_wxyz, scalar_first=True)
    rotation = (after * before.inv()).mean().as_matrix()
    shift_m = corrections.after_m.mean(axis=0) - rotation @ corrections.before_m.mean(axis=0)
    return MeanCorrection(rotation, shift_m, corrections.scale)


def check_same_motion(corrections: PoseCorrections) -> None:
    """Refuse two trajectories whose motions between poses are not the same ones, only a little corrected.

    Raises:
        CloudError: half of the way was changed by more than half: other body axes, another scale, another recording.
    """
    step_m = np.linalg.norm(np.diff(corrections.before_m, axis=0), axis=1)
    length_m = float(step_m.sum())
    if length_m == 0.0:
        return
    share = np.linalg.norm(corrections.change[:, :3], axis=1) / np.where(step_m > 0.0, step_m, 1.0)
    order = np.argsort(share)
    median = float(share[order][np.searchsorted(np.cumsum(step_m[order]), 0.5 * length_m)])
    if median <= _MOST_CHANGE:
        return
    after_m = float(np.linalg.norm(np.diff(corrections.after_m, axis=0), axis=1).sum())
    ratio = after_m / length_m
    hint = (
        f"The path is {ratio:.4g} times as long: for a map whose unit is not the metre give --scale."
        if abs(np.log(ratio)) > np.log(1.0 + _MOST_CHANGE)
        else "Have the bodies the same axes, and is it the same recording?"
    )
    raise CloudError(
        f"the motions between poses differ by {median:.0%} of their length, before and after (median along the path); "
        f"expected the same trajectory, corrected by a few per cent. {hint}"
    )


def check_one_frame(corrections: PoseCorrections, points_m: Float[np.ndarray, "n 3"]) -> None:
    """Refuse points that lie too far from the trajectory to have been seen from it.

    Raises:
        CloudError: their middle is more than 5 km and ten times the trajectory's extent away.
    """
    if not len(points_m):
        return
    extent_m = float(np.ptp(corrections.before_m, axis=0).max())
    middle_m, path_m = corrections.scale * np.median(points_m, axis=0), np.median(corrections.before_m, axis=0)
    away_m = float(np.linalg.norm(middle_m - path_m))
    if away_m > _FARTHEST_M + _FARTHEST_EXTENTS * extent_m:
        raise CloudError(
            f"the cloud lies {away_m:.6g} m from the trajectory before, which is {extent_m:.3g} m wide: their middles "
            f"are {np.round(middle_m, 1).tolist()} and {np.round(path_m, 1).tolist()}. Expected both in one frame: "
            "give --before as it was when the cloud was made."
        )
