"""Over how long a difference the rig's velocity is taken, and how much of it is the odometry's own jitter.

The estimate of a time offset leans on the velocity. A velocity from poses Delta apart holds the odometry's random walk
besides the motion, and the information J'PJ counts both: too much by a factor kappa, and the offset scatters kappa
times wider than it says (errors in variables). What a real motion tells must also show in the misfit, which rises by
the true information times the offset squared. So kappa is measured,

    kappa(Delta) = 2 d^2 J'PJ / [misfit(+d) + misfit(-d) - 2 misfit(0)]

arm and rotation free, d a few standard deviations, and the difference with the least scatter, kappa^2 / J'PJ, is taken.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgeo.solve.corrections import DIFFERENCES_S, FIRST_DIFFERENCE_S, N_CORRECTIONS, TIME
from jaxgeo.solve.corrections_within import Weights, Within, WithinInformation, reduced

# The misfit's rise is taken this many standard deviations of the offset away, a pose's spacing at least, and not so far
# that `visits_within` would not have the sightings.
_AWAY = 4.0
_FARTHEST_S = 0.15
# kappa is at most one over this: a misfit that does not rise at all is chance.
_LEAST_RISE = 0.05
# Visits that tell less than this share of the prior's information have no choice to make.
_LEAST_TOLD = 0.01


@jax.jit
def _profiled(log_sigma: Array, data: Within, weights: Weights, held: Array) -> tuple[Array, Array]:
    """Misfit where the clock stands and what may move has moved; and the offset's information, the same free."""
    each = reduced(log_sigma, data, weights)
    information, pull = each.information.sum(0), -each.pull.sum(0)
    curvature = jnp.eye(N_CORRECTIONS) + held[:, None] * information * held[None]
    gain = held * pull
    across = held * information[TIME]
    solved = jnp.linalg.solve(curvature, jnp.stack([gain, across], axis=1))
    return each.square.sum() - gain @ solved[:, 0], information[TIME, TIME] - across @ solved[:, 1]


def choose_difference(
    composed: Callable[[Float[np.ndarray, "7"], float], Within],
    value: Float[np.ndarray, "7"],
    within: WithinInformation,
    prior_sigma: Float[np.ndarray, "7"],
    spacing_s: float,
) -> tuple[float, float]:
    """The difference in seconds and its kappa, 1 or more, at corrections near their best.

    Args:
        composed: the visits at given corrections and difference.
        within: what they said at `value`; its noise and weights are used.
        spacing_s: of the trajectory's poses.
    """
    held = jnp.asarray(prior_sigma * (np.arange(N_CORRECTIONS) != TIME))
    log_sigma = jnp.asarray(within.log_sigma)

    def at(offset_s: float, difference_s: float) -> tuple[float, float]:
        moved = value.copy()
        moved[TIME] += offset_s
        square, information = _profiled(log_sigma, composed(moved, difference_s), within.weights, held)
        return float(square), float(information)

    here = {difference_s: at(0.0, difference_s) for difference_s in DIFFERENCES_S}
    claimed = np.array([information for _, information in here.values()])
    if claimed.max() < _LEAST_TOLD / prior_sigma[TIME] ** 2:
        return FIRST_DIFFERENCE_S, 1.0
    widest = 1.0 / np.sqrt(claimed.min() + prior_sigma[TIME] ** -2)
    away_s = min(max(_AWAY * widest, spacing_s), _FARTHEST_S)
    first = DIFFERENCES_S[0]
    rise = (at(away_s, first)[0] + at(-away_s, first)[0] - 2.0 * here[first][0]) / (2.0 * away_s**2)
    excess = np.maximum(claimed / np.maximum(rise, _LEAST_RISE * claimed), 1.0)
    best = int(np.argmin(excess**2 / claimed))
    return DIFFERENCES_S[best], float(excess[best])
