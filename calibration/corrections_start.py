"""Offsets of the clock to start from: what a turning rig sees has several near misses, each in a valley."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from calibration.corrections_between import Between
from calibration.corrections_problem import Problem
from jaxgeo.solve.corrections import FIRST_DIFFERENCE_S, N_CORRECTIONS, TIME
from jaxgeo.solve.corrections_within import scan_value

# A hand's shaking turns round within 0.1 s: single visits are scanned finely. Whole visits average over it.
_FINE_S = 0.02
_COARSE_SHARE = 0.5  # of the prior's standard deviation
# Valleys this much higher than the lowest (of a negative log probability) are not entered; at most so many are.
_WORSE = 25.0
_MOST = 3
# Where single visits put every other offset this much higher, the survey, some tens at most, cannot change it.
_DECIDED = 200.0


def starting_offsets_s(problem: Problem) -> list[float]:
    """The lowest minima over offsets of up to three prior widths, each offset held while arm and rotation are free."""
    reach_s, sigma = problem.prior.reach_s, problem.sigma
    if reach_s == 0.0:
        return [0.0]
    held = sigma * (np.arange(N_CORRECTIONS) != TIME)
    fine_s = np.linspace(-reach_s, reach_s, 2 * max(6, round(reach_s / _FINE_S)) + 1)
    cost = 0.5 * (fine_s / sigma[TIME]) ** 2 + _visits_cost(problem, fine_s, held)
    elsewhere = np.abs(fine_s - fine_s[np.argmin(cost)]) > sigma[TIME] / 2.0
    if problem.fixes_frame and np.min(cost[elsewhere]) < np.min(cost) + _DECIDED:
        cost += _survey_cost(problem, fine_s, held)
    lower = np.r_[True, cost[1:] < cost[:-1]] & np.r_[cost[:-1] <= cost[1:], True]
    minima = np.flatnonzero(lower)
    minima = minima[np.argsort(cost[minima])]
    return [float(fine_s[i]) for i in minima[cost[minima] < cost[minima[0]] + _WORSE][:_MOST]]


def _at(offset_s: float) -> Float[np.ndarray, "7"]:
    value = np.zeros(N_CORRECTIONS)
    value[TIME] = offset_s
    return value


def _visits_cost(
    problem: Problem, offset_s: Float[np.ndarray, "n"], held: Float[np.ndarray, "7"]
) -> Float[np.ndarray, "n"]:
    log_sigma = jnp.asarray(problem.asked_within(_at(0.0), FIRST_DIFFERENCE_S, None).log_sigma)
    middle, width = jnp.zeros(N_CORRECTIONS), jnp.asarray(held)
    return np.array(
        [float(scan_value(log_sigma, problem.composed(_at(s), FIRST_DIFFERENCE_S), middle, width)) for s in offset_s]
    )


def _survey_cost(
    problem: Problem, offset_s: Float[np.ndarray, "n"], held: Float[np.ndarray, "7"]
) -> Float[np.ndarray, "n"]:
    """Negative log-evidence of the anchors, worked out at coarse steps; where it is not found it says nothing."""
    reach_s, root = problem.prior.reach_s, jnp.asarray(np.diag(held))
    coarse_s = np.linspace(-reach_s, reach_s, 2 * round(3.0 / _COARSE_SHARE) + 1)
    theta, cost = None, []
    for s in coarse_s:
        step = problem.asked_between(_at(s), FIRST_DIFFERENCE_S, Between(jnp.asarray(_at(s)), root), theta, None)
        theta = step.fit.theta if theta is None else theta
        cost.append(-float(step.log_evidence))
    good = np.isfinite(cost)
    return np.interp(offset_s, coarse_s[good], np.array(cost)[good]) if good.any() else np.zeros_like(offset_s)
