"""Leave one location out: every visit of a location held out in turn, all folds in one compiled call."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from calibration.calibrate import LearnSettings, calibrate_and_correct
from calibration.learn import LEARNING_ROUNDS, noise_held
from calibration.result import Calibration
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import ConvergenceError
from jaxgeo.export.result import HeldOut
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Correction, Settings, correct_with_folds
from jaxgeo.solve.ensemble_correct import EnsembleCorrection, ensemble_correction
from jaxgeo.solve.ensemble_fold import EnsembleFold, solve_ensemble
from jaxgeo.solve.fold import Fold
from jaxgeo.solve.solver import result_words, succeeded


@dataclasses.dataclass(frozen=True)
class LeaveOneOut:
    """Held-out errors of the one-time similarity and of the graph, and what each location's own fold predicts for it.

    Attributes:
        coarse, refined: errors of every visit in the fold that held its location out.
        point_m: (k, 3) marker positions that fold predicts, local frame.
        determined: (k,) whether the other locations fix the frame.
    """

    coarse: HeldOut
    refined: HeldOut
    point_m: Float[np.ndarray, "k 3"]
    determined: Bool[np.ndarray, "k"]


@dataclasses.dataclass(frozen=True)
class EnsembleHeldOut:
    """Held-out errors under a noise ensemble: learned in each fold anew, or one ensemble for all.

    Attributes:
        refined: errors of every visit in the fold that held its location out.
        point_m: (k, 3) marker positions that fold predicts, local frame.
    """

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
    correction, folds = correct_with_folds(trajectory, anchors, noise, settings, without_each_location(anchors))
    return correction, _gather(folds, anchors)


def learn_and_hold_out(
    trajectory: Trajectory, anchors: Anchors, settings: Settings, learn: LearnSettings, fixed: LeaveOneOut | None
) -> tuple[Calibration, EnsembleCorrection, EnsembleHeldOut | None]:
    """Learn the noise and correct with all anchors; and, for each location, learn and correct anew without it.

    Args:
        fixed: of the same anchors with a fixed noise, which says what folds are determined; None: nothing held out.

    A fold that is not determined, or in which learning and correcting do not settle, gives NaN and says why.

    Raises:
        ConvergenceError: learning with all anchors did not settle.
    """
    use = _solvable_folds(anchors, fixed)
    calibration, correction, learned = calibrate_and_correct(trajectory, anchors, settings, learn, use)
    if fixed is None:
        return calibration, correction, None
    fold = jax.tree.map(lambda x: x[1:], learned.fold)  # the first is that of all anchors
    point, covariance = np.asarray(fold.point_m), np.asarray(fold.error_covariance_m2)
    settled, rounds = np.asarray(fold.settled), np.asarray(fold.rounds)
    good = np.where(noise_held(rounds), f"converged, the noise held after {LEARNING_ROUNDS} rounds", "converged")
    return calibration, correction, _gather_ensemble(point, covariance, settled, rounds, good, anchors, fixed)


def correct_under_and_hold_out(
    trajectory: Trajectory, anchors: Anchors, settings: Settings, ensemble: NoiseEnsemble, fixed: LeaveOneOut | None
) -> tuple[EnsembleCorrection, EnsembleHeldOut | None]:
    """Correct under one given ensemble, with all anchors and without each location; else as `learn_and_hold_out`.

    Raises:
        ConvergenceError: the correction with all anchors did not settle.
    """
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    options = settings.ensemble_options()
    width = jnp.asarray(settings.loss_width)

    def solved(use: Float[np.ndarray, "k"]) -> EnsembleFold:
        row = jnp.asarray(np.pad(use, (0, table.real.shape[0] - len(use))))
        return solve_ensemble(chain, table, ensemble, row, width, options)

    whole = solved(np.ones(len(anchors)))
    if not bool(whole.settled):
        raise ConvergenceError(
            f"correcting under the noise of noise.file did not settle: after {int(whole.rounds)} rounds a marker still "
            "moved. Check for wrong anchors (anchors.loss: cauchy tolerates some), or learn from this session "
            "(noise.mode: learned)."
        )
    correction = ensemble_correction(trajectory, chain, whole)
    if fixed is None:
        return correction, None
    folds = [solved(row) for row in _solvable_folds(anchors, fixed)]
    point, covariance, settled, rounds = (
        np.array([np.asarray(getattr(fold, name)) for fold in folds])
        for name in ("point_m", "error_covariance_m2", "settled", "rounds")
    )
    good = np.full(len(folds), "converged")
    return correction, _gather_ensemble(point, covariance, settled, rounds, good, anchors, fixed)


def without_each_location(anchors: Anchors) -> Float[np.ndarray, "f k"]:
    """A row for each location: 1 for the visits of all others."""
    locations = np.arange(int(anchors.location_index.max()) + 1)
    return (locations[:, None] != anchors.location_index[None, :]).astype(float)


def _solvable_folds(anchors: Anchors, fixed: LeaveOneOut | None) -> Float[np.ndarray, "f k"]:
    """The folds; one that is not determined keeps all anchors, for its answer is thrown away."""
    if fixed is None:
        return np.zeros((0, len(anchors)))
    use = without_each_location(anchors)
    use[anchors.location_index[~fixed.determined]] = 1.0
    return use


def _gather_ensemble(
    point_m: Float[np.ndarray, "f k 3"],
    covariance_m2: Float[np.ndarray, "f k 3 3"],
    settled: Bool[np.ndarray, "f"],
    rounds: Int[np.ndarray, "f"],
    words: Shaped[np.ndarray, "f"],
    anchors: Anchors,
    fixed: LeaveOneOut,
) -> EnsembleHeldOut:
    """Each visit's row from the fold of its own location; `words` say how a fold that settled did."""
    fold, visit = anchors.location_index, np.arange(len(anchors))
    result = []
    for i in visit:
        if not fixed.determined[i]:
            result.append(fixed.refined.result[i])
        else:
            unsettled = f"not settled after {int(rounds[fold[i]])} rounds"
            result.append(str(words[fold[i]]) if settled[fold[i]] else unsettled)
    good = np.asarray(settled)[fold] & fixed.determined
    point = np.where(good[:, None], np.asarray(point_m)[fold, visit], np.nan)
    covariance = np.where(good[:, None, None], np.asarray(covariance_m2)[fold, visit], np.nan)
    return EnsembleHeldOut(HeldOut(point - anchors.surveyed_enh_m, covariance, tuple(result)), point)


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
        HeldOut(coarse - surveyed, nothing, coarse_result),
        HeldOut(point - surveyed, covariance, result),
        point,
        determined,
    )
