"""Leave one location out: every visit of a location held out in turn, all folds in one compiled call."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.export.result import HeldOut
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Correction, Settings, correct_with_folds
from jaxgeo.solve.fold import Fold
from jaxgeo.solve.solver import result_words, succeeded


@dataclasses.dataclass(frozen=True)
class LeaveOneOut:
    """Held-out errors of the one-time similarity and of the graph, and what each location's own fold predicts for it.

    Attributes:
        coarse, refined: errors of every visit in the fold that held its location out.
        point_m: (k, 3) marker positions that fold predicts, local frame.
    """

    coarse: HeldOut
    refined: HeldOut
    point_m: Float[np.ndarray, "k 3"]


def correct_and_hold_out(
    trajectory: Trajectory, anchors: Anchors, noise: OdometryNoise, settings: Settings
) -> tuple[Correction, LeaveOneOut]:
    """Correct with all anchors; and hold out each location's visits, solve anew with the rest, and predict them.

    A fold whose anchors do not fix the frame, or whose solve does not converge, gives NaN and says why.

    Raises:
        UndeterminedError, ConvergenceError: of the correction with all anchors.
    """
    locations = np.arange(int(anchors.location_index.max()) + 1)
    use = (locations[:, None] != anchors.location_index[None, :]).astype(float)
    correction, folds = correct_with_folds(trajectory, anchors, noise, settings, use)
    return correction, _gather(folds, anchors)


def _gather(found: Fold, anchors: Anchors) -> LeaveOneOut:
    """Each visit's row from the fold of its own location."""
    fold, visit = anchors.location_index, np.arange(len(anchors))
    determined = np.asarray(found.determined)[fold]
    words = [result_words(jax.tree.map(lambda code, f=f: code[f], found.solution.result)) for f in fold]
    result = tuple(
        word if ok else "undetermined: the other locations do not fix the frame"
        for word, ok in zip(words, determined, strict=True)
    )
    good = np.asarray(succeeded(found.solution.result))[fold] & determined
    point = np.where(good[:, None], np.asarray(found.point_m)[fold, visit], np.nan)
    coarse = np.where(determined[:, None], np.asarray(found.coarse_point_m)[fold, visit], np.nan)
    covariance = np.where(good[:, None, None], np.asarray(found.error_covariance_m2)[fold, visit], np.nan)
    coarse_result = tuple("closed form" if ok else r for ok, r in zip(determined, result, strict=True))
    surveyed = anchors.surveyed_enh_m
    nothing = np.full_like(covariance, np.nan)
    return LeaveOneOut(
        HeldOut(coarse - surveyed, nothing, coarse_result), HeldOut(point - surveyed, covariance, result), point
    )
