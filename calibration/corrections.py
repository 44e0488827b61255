"""Time offset, lever arm and rotation of the camera, estimated together with the poses and the odometry's noise.

Two kinds of evidence, independent given the corrections: a marker must stand still while it is seen
(`corrections_within`), and visits must lie where the survey has them (`corrections_between`). Anchors are made anew at
every estimate, until neither corrections nor poses move.
"""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.calibrate import LearnSettings
from calibration.corrections_between import Between
from calibration.corrections_problem import Problem, problem_of
from calibration.corrections_start import starting_offsets_s
from jaxgeo.data import Sightings, Survey, Trajectory, Visit
from jaxgeo.errors import ConvergenceError
from jaxgeo.precision import assert_float64
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.corrections import FIRST_DIFFERENCE_S, N_CORRECTIONS, TIME, CorrectionPrior, Motion, motion_seen
from jaxgeo.solve.corrections_difference import choose_difference
from jaxgeo.solve.corrections_within import WithinInformation

# Settled: no correction moves by more than this share of its standard deviation.
_SETTLED = 0.03
_MOST_ROUNDS = 25
# Two starts that end nearer than this, in standard deviations of the offset, found one and the same.
_SAME = 3.0


@dataclasses.dataclass(frozen=True)
class CorrectionEstimate:
    """Posterior of the corrections, and what it rests on.

    Attributes:
        value, covariance: (7,), (7, 7) in the order of `CORRECTIONS`; `prior_sigma` (7,).
        within, between: (7, 7) information of single visits and of the survey; `between` zero where the frame is free.
        rival_s: another offset that settled, None without one; `rival_odds` how probable it is beside the best.
        rounds: linearisations taken.
        visits, sightings: how many entered.
        motion: of the rig while it saw markers.
    """

    value: Float[np.ndarray, "7"]
    covariance: Float[np.ndarray, "7 7"]
    prior_sigma: Float[np.ndarray, "7"]
    within: Float[np.ndarray, "7 7"]
    between: Float[np.ndarray, "7 7"]
    rival_s: float | None
    rival_odds: float
    rounds: int
    visits: int
    sightings: int
    motion: Motion

    @property
    def sigma(self) -> Float[np.ndarray, "7"]:
        return np.sqrt(np.diag(self.covariance))


def estimate_corrections(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    survey: Survey,
    *,
    origin_enh_m: Float[np.ndarray, "3"],
    settings: Settings,
    learn: LearnSettings,
    prior: CorrectionPrior,
) -> CorrectionEstimate:
    """Estimate the corrections from these labelled visits and nothing else: in a fold, give it those that train.

    Raises:
        SightingError: no sighting can be used, or one that `make_anchors` refuses.
        ConvergenceError: the corrections did not settle from any start.
    """
    assert_float64()
    problem = problem_of(trajectory, sightings, visits, survey, origin_enh_m, settings, learn, prior)
    starts = starting_offsets_s(problem)
    found = sorted(filter(None, (_settle(problem, s) for s in starts)), key=lambda each: each.cost)
    if not found:
        raise ConvergenceError(
            f"the corrections did not settle within {_MOST_ROUNDS} rounds from any of {len(starts)} offsets. Check for "
            "wrong anchors, or give the corrections smaller widths."
        )
    best = found[0]
    sigma_s = np.sqrt(best.covariance[TIME, TIME])
    rival = next((each for each in found[1:] if abs(each.value[TIME] - best.value[TIME]) > _SAME * sigma_s), None)
    return CorrectionEstimate(
        value=best.value,
        covariance=best.covariance,
        prior_sigma=problem.sigma,
        within=best.within.information,
        between=best.between,
        rival_s=None if rival is None else float(rival.value[TIME]),
        rival_odds=0.0 if rival is None else float(np.exp(best.cost - rival.cost)),
        rounds=best.rounds,
        visits=len(problem.visits),
        sightings=sum(visit.count for visit in problem.visits),
        motion=motion_seen(trajectory, sightings, problem.visits, best.value, best.difference_s),
    )


@dataclasses.dataclass(frozen=True)
class _Settled:
    """Where one start ended; `cost` is the negative log probability of all that was seen."""

    value: Float[np.ndarray, "7"]
    covariance: Float[np.ndarray, "7 7"]
    within: WithinInformation
    between: Float[np.ndarray, "7 7"]
    theta: Array | None
    cost: float
    rounds: int
    difference_s: float = FIRST_DIFFERENCE_S


def _settle(problem: Problem, start_s: float) -> _Settled | None:
    """Settled from one offset, then again with the difference for the velocity that it asks for; None: it did not."""
    value = np.zeros(N_CORRECTIONS)
    value[TIME] = start_s
    found = _rounds(problem, value, FIRST_DIFFERENCE_S, 1.0, None)
    if found is None or problem.sigma[TIME] == 0.0:
        return found
    spacing_s = float(np.median(np.diff(problem.trajectory.stamp_s)))
    difference_s, excess = choose_difference(problem.composed, found.value, found.within, problem.sigma, spacing_s)
    return _rounds(problem, found.value, difference_s, excess, found)


def _rounds(
    problem: Problem, value: Float[np.ndarray, "7"], difference_s: float, excess: float, before: _Settled | None
) -> _Settled | None:
    """Rounds of visits, anchors, noise and corrections; `excess` as in `corrections_difference`."""
    reach_s, free = problem.prior.reach_s, problem.sigma > 0
    log_sigma, theta, state = (None, None, None) if before is None else (before.within.log_sigma, before.theta, None)
    for turn in range(1, _MOST_ROUNDS + 1):
        within = _less_sure(problem.asked_within(value, difference_s, log_sigma), excess)
        known = _knowledge(value, within, problem.sigma)
        new, root = np.array(known.mean), np.asarray(known.root)
        covariance, between, cost = root @ root.T, np.zeros_like(root), within.value
        if problem.fixes_frame:
            step = problem.asked_between(value, difference_s, known, theta, state)
            theta, state = step.fit.theta, step.state
            new, covariance, between = np.array(step.mean), np.asarray(step.covariance), np.asarray(step.information)
            cost -= float(step.log_evidence)
        if not (np.all(np.isfinite(new)) and np.isfinite(cost)):
            return None
        # Sightings for offsets beyond are not in the problem.
        new[TIME] = np.clip(new[TIME], -reach_s, reach_s)
        moved = np.abs(new - value)[free] / np.sqrt(np.diag(covariance))[free]
        log_sigma = within.log_sigma
        if np.max(moved) < _SETTLED:
            return _Settled(new, covariance, within, between, theta, cost, turn, difference_s)
        # Jitter makes the pull steeper than what it tells: whole steps would go to and fro.
        value = value + (new - value) / excess
    return None


def _less_sure(within: WithinInformation, excess: float) -> WithinInformation:
    """The offset's share of the information divided by kappa, and its own by kappa squared."""
    divide = np.where(np.arange(N_CORRECTIONS) == TIME, 1.0 / excess, 1.0)
    information, pull = within.information * divide[:, None] * divide, within.pull * divide
    return WithinInformation(information, pull, within.log_sigma, within.weights, within.value)


def _knowledge(value: Float[np.ndarray, "7"], within: WithinInformation, sigma: Float[np.ndarray, "7"]) -> Between:
    """Prior and single visits together: the normal posterior of the corrections before the survey is asked."""
    curvature = np.eye(N_CORRECTIONS) + sigma[:, None] * within.information * sigma
    root = sigma[:, None] * np.linalg.inv(np.linalg.cholesky(curvature)).T
    mean = root @ root.T @ (within.pull + within.information @ value)
    return Between(jnp.asarray(mean), jnp.asarray(root))
