"""Everything that is held out, repeated and compared for one trajectory: what the tables and figures read."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.calibrate import LearnSettings
from eval.cost import CostRow, trajectory_cost
from eval.first_visits import FirstVisits, first_visits
from eval.loo import EnsembleHeldOut, LeaveOneOut, correct_and_hold_out, correct_under_and_hold_out
from eval.reference import RelativeError, absolute_error, relative_errors
from eval.revisit import revisit_gaps
from eval.subsets import (
    SubsetErrors,
    ensemble_subsets,
    fixed_subsets,
    learned_subsets,
    similarity_subsets,
)
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import ConvergenceError
from jaxgeo.export.held_out_stats import final_stage
from jaxgeo.export.result import HeldOut, ReferenceError, TrajectoryResult
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_correct import EnsembleCorrection

# In the order of the tables: `true` is the noise that a simulated trajectory was drawn from.
STAGES = ("coarse", "fixed", "learned", "true")
STAGE_NAME = {
    "first": "similarity, first visits",
    "coarse": "one-time similarity",
    "fixed": "fixed noise",
    "learned": "learned noise",
    "true": "true noise",
}
# Motions over these distances are compared with a reference, where the path is at least twice as long.
DISTANCES_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
# Beyond so many locations only some numbers of anchors are tried: the choices of the others say little more.
ALL_COUNTS = 8
COUNTS = (3, 4, 5, 6, 8, 12)


@dataclasses.dataclass(frozen=True)
class TrajectoryEvaluation:
    """One trajectory of one session.

    Attributes:
        session, name: of the session and of the trajectory in it; `simulated`, `seed` of the session.
        result: of the run.
        held_out: leave-one-out errors by stage, `true` among them where the true noise is known.
        revisit_m: {stage: {location: (all anchors in, location held out)}}, see `eval.revisit`.
        subsets: errors with fewer anchors by stage; `first` is the similarity to each location's first visit,
            where some have several.
        first: see `eval.first_visits`.
        estimates: the trajectory after each stage, local frame.
        absolute: error of each against the reference by stage, and `relative` drift of `measured` (the odometry) and
            `corrected`; empty without a reference.
        cost: seconds by stage; empty where they were not asked for.
        versions: of what computed it.
    """

    session: str
    name: str
    simulated: bool
    seed: int
    result: TrajectoryResult
    held_out: dict[str, HeldOut]
    revisit_m: dict[str, dict[str, tuple[float, float]]]
    subsets: dict[str, tuple[SubsetErrors, ...]]
    first: FirstVisits | None
    estimates: dict[str, Trajectory]
    absolute: dict[str, ReferenceError]
    relative: dict[str, tuple[RelativeError, ...]]
    cost: tuple[CostRow, ...]
    versions: dict[str, str]

    @property
    def anchors(self) -> Anchors:
        return self.result.anchors


@dataclasses.dataclass(frozen=True)
class EvaluationInput:
    """What was done to a trajectory, to do it again with fewer anchors.

    Attributes:
        settings, noise: of the estimator, and the fixed noise.
        ensemble: another session's noise, where the run used that as it is in place of the fixed one.
        learn: None where the noise was not learned.
        true: the noise that the trajectory was drawn from, where it was.
        reference: in the session's local frame or, `reference_own_frame`, in one of its own; `reference_arm_m` its
            body's origin in the trajectory's body.
        most_subsets: of one number of anchors; 0: none.
        cost: measure it.
    """

    settings: Settings
    noise: OdometryNoise
    learn: LearnSettings | None
    ensemble: NoiseEnsemble | None = None
    true: NoiseEnsemble | None = None
    reference: Trajectory | None = None
    reference_own_frame: bool = False
    reference_arm_m: Sequence[float] = (0.0, 0.0, 0.0)
    most_subsets: int = 40
    cost: bool = True


def evaluate_trajectory(
    session: str,
    simulated: bool,
    seed: int,
    versions: dict[str, str],
    result: TrajectoryResult,
    given: EvaluationInput,
    say: Callable[[str], None] = lambda _: None,
) -> TrajectoryEvaluation:
    """Evaluate one trajectory of a run; `say` is told what is done next.

    Raises:
        UndeterminedError, ConvergenceError: of the correction with all anchors and the fixed noise.
    """
    trajectory, anchors = result.measured, result.anchors
    say("hold out")
    correction, fixed = correct_and_hold_out(trajectory, anchors, given.noise, given.settings)
    k = len(anchors)
    held_out = {"coarse": fixed.coarse, "fixed": fixed.refined} | result.held_out
    all_in = {
        "coarse": np.asarray(correction.fold.coarse_point_m)[:k],
        "fixed": np.asarray(correction.fold.point_m)[:k],
        final_stage(result): result.residual_refined_m + anchors.surveyed_enh_m,
    }
    estimates = {"coarse": correction.coarse, "fixed": correction.corrected, final_stage(result): result.corrected}
    if given.true is not None:
        held_out["true"], under_true = _under_true_noise(trajectory, anchors, given.settings, given.true, fixed)
        if under_true is not None:
            all_in["true"], estimates["true"] = under_true.point_m[:k], under_true.corrected
    say("hold out choices of anchors")
    subsets = _subsets(trajectory, anchors, given)
    say("compare")
    relative, absolute = {}, {}
    if given.reference is not None:
        arm, align = given.reference_arm_m, "se3" if given.reference_own_frame else "none"
        relative = _relative(result, given.reference, arm)
        absolute = {
            stage: absolute_error(estimate, given.reference, t_body_reference_m=arm, align=align)
            for stage, estimate in estimates.items()
        }
    cost: tuple[CostRow, ...] = ()
    if given.cost:
        say("measure cost")
        cost = trajectory_cost(trajectory, anchors, given.noise, given.settings, given.learn)
    return TrajectoryEvaluation(
        session=session,
        name=result.name,
        simulated=simulated,
        seed=seed,
        result=result,
        held_out={stage: held_out[stage] for stage in STAGES if stage in held_out},
        revisit_m={stage: _gaps(anchors, all_in[stage], held_out[stage]) for stage in STAGES if stage in all_in},
        subsets=subsets,
        first=first_visits(trajectory, anchors, given.settings),
        estimates=estimates,
        absolute=absolute,
        relative=relative,
        cost=cost,
        versions=versions,
    )


def counts_of(n_locations: int) -> tuple[int, ...]:
    """Numbers of anchors to try, all of them first."""
    if n_locations <= ALL_COUNTS:
        return tuple(range(n_locations, 2, -1))
    fewer = (k for k in COUNTS if k < n_locations)
    return tuple(sorted({n_locations, n_locations - 1, *fewer}, reverse=True))


def _under_true_noise(
    trajectory: Trajectory, anchors: Anchors, settings: Settings, true: NoiseEnsemble, fixed: LeaveOneOut
) -> tuple[HeldOut, EnsembleCorrection | None]:
    """Held out under the true noise, and corrected with all anchors; all failed where that does not settle."""
    k = len(anchors)
    try:
        correction, predicted = correct_under_and_hold_out(trajectory, anchors, settings, true, fixed)
    except ConvergenceError:
        failed = ("not settled with all anchors",) * k
        return HeldOut(np.full((k, 3), np.nan), np.full((k, 3, 3), np.nan), failed), None
    assert isinstance(predicted, EnsembleHeldOut)  # folds were asked for
    return predicted.refined, correction


def _gaps(anchors: Anchors, all_in_m: Float[np.ndarray, "k 3"], held_out: HeldOut) -> dict[str, tuple[float, float]]:
    points = {"in": all_in_m, "out": held_out.error_enh_m + anchors.surveyed_enh_m}
    return {name: (gap["in"], gap["out"]) for name, gap in revisit_gaps(anchors.location, points).items()}


def _subsets(trajectory: Trajectory, anchors: Anchors, given: EvaluationInput) -> dict[str, tuple[SubsetErrors, ...]]:
    n = int(anchors.location_index.max()) + 1
    if given.most_subsets == 0 or n < 4:
        return {}
    settings, ks, most = given.settings, counts_of(n), given.most_subsets
    found: dict[str, tuple[SubsetErrors, ...]] = {}
    if n < len(anchors):
        found["first"] = similarity_subsets(trajectory, anchors, settings, ks, visits="first", most=most)
    found["coarse"] = similarity_subsets(trajectory, anchors, settings, ks, most=most)
    if given.ensemble is None:
        found["fixed"] = fixed_subsets(trajectory, anchors, given.noise, settings, ks, most=most)
    else:
        found["fixed"] = ensemble_subsets(trajectory, anchors, settings, given.ensemble, ks, most=most)
    if given.learn is not None:
        found["learned"] = learned_subsets(trajectory, anchors, settings, given.learn, ks, most=most)
    if given.true is not None:
        found["true"] = ensemble_subsets(trajectory, anchors, settings, given.true, ks, most=most)
    return found


def _relative(result: TrajectoryResult, reference: Trajectory, arm_m: Any) -> dict[str, tuple[RelativeError, ...]]:
    path_m = float(np.linalg.norm(np.diff(result.corrected.position_m, axis=0), axis=1).sum())
    distances = [d for d in DISTANCES_M if 2.0 * d <= path_m]
    estimates = {"measured": result.measured, "corrected": result.corrected}
    return {
        name: relative_errors(estimate, reference, distances, t_body_reference_m=arm_m)
        for name, estimate in estimates.items()
    }
