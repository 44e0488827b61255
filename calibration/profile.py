"""Profile likelihood of every sigma: how much worse the best explanation becomes when one sigma is held elsewhere.

For a direction a in theta = log sigma (one component, or the mean of three axes) and a value v,

    drop(v) = min over a' theta = v of f(theta)  -  min f(theta)        f = negative_log_posterior

in nats; the sigmas where it is below 1.92, half the 95 % point of chi-square with one degree of freedom, are the
interval (Venzon and Moolgavkar 1988). Unlike Laplace's it may be lopsided, or open: data that cannot tell a sigma from
zero bound it from above only. The other sigmas are found by Newton's steps in the directions that leave a' theta alone,
with the exact Hessian, its eigenvalues made positive: away from the optimum of all sigmas the average information of
`calibration.average_information` is far from the Hessian, and its steps needed hundreds where these need ten.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from calibration.learn import Learned
from calibration.reml import Contrasts, Prior, derivatives, hessian, negative_log_posterior
from calibration.summary import GROUPS
from jaxgeo.graph.components import COMPONENTS, N_COMPONENTS

POINTS = 13
# Half the chi-square quantile of 95 %, one degree of freedom.
DROP_95 = 1.9207294
# The grid reaches this many of Laplace's standard deviations to both sides, and at least `_AT_LEAST` in log sigma.
_SPAN_SD = 3.0
_AT_LEAST = 1.5
# An end where the drop, prior included, stays below `DROP_95`: the grid of that sigma is made twice as wide, at most
# this often. What is open then is said to be open.
_WIDENED = 2
# A profile's point is found when a step would gain less than this many nats.
_ATOL = 1e-8
_MAX_STEPS = 60
# A step changes no sigma by more than this factor (e^1.5), so that a flat likelihood is not overshot.
_LONGEST = 1.5
_DAMPING_FIRST, _DAMPING_HIGHEST = 1e-2, 1e8


@dataclasses.dataclass(frozen=True)
class ProfileLikelihood:
    """One sigma's profile in one model.

    Attributes:
        component: one of `COMPONENTS`, or of `GROUPS` for the geometric mean of three axes.
        sigma: (g,) rising.
        drop: (g,) nats, prior included; NaN where the minimiser did not converge.
        drop_likelihood: (g,) of the restricted likelihood alone at the same points, above its best on the path.
        interval_95: where `drop` is below 1.92; an end that the grid does not reach is None.
        likelihood_interval_95: the same of `drop_likelihood`: what the data bound without the prior.
    """

    component: str
    sigma: Float[np.ndarray, "g"]
    drop: Float[np.ndarray, "g"]
    drop_likelihood: Float[np.ndarray, "g"]
    interval_95: tuple[float | None, float | None]
    likelihood_interval_95: tuple[float | None, float | None]


def profile_likelihoods(learned: Learned, model: int | None = None) -> tuple[ProfileLikelihood, ...]:
    """Profiles of every sigma of one model (by default the most probable one), then those of the groups it has.

    `learned` is one fold, without a leading axis of folds. All points of all profiles are one compiled call; it is
    repeated where a grid must be widened.
    """
    if model is None:
        model = int(np.argmax(np.asarray(learned.model_weight)))
    prior: Prior = jax.tree.map(lambda x: jnp.asarray(x)[model], learned.prior)
    theta, covariance = jnp.asarray(learned.fit.theta)[model], jnp.asarray(learned.fit.covariance)[model]
    picks = _picks(np.asarray(prior.free) > 0)
    pick = jnp.asarray(np.stack(list(picks.values())))
    sd = np.sqrt(np.einsum("da,ab,db->d", pick, covariance, pick))
    reach = np.maximum(_SPAN_SD * sd, _AT_LEAST)
    found: Contrasts = jax.tree.map(jnp.asarray, learned.found)
    for attempt in range(_WIDENED + 1):
        path = _Path(*(np.asarray(x) for x in _paths(found, prior, theta, covariance, pick, jnp.asarray(reach))))
        drop = _above_best(path.value, path.converged)
        short = (drop[:, 0] < DROP_95) | (drop[:, -1] < DROP_95)
        if attempt == _WIDENED or not short.any():
            break
        reach = np.where(short, 2.0 * reach, reach)
    likelihood = _above_best(path.likelihood, path.converged)
    return tuple(
        _profile(name, np.exp(at), own, alone)
        for name, at, own, alone in zip(picks, path.at, drop, likelihood, strict=True)
    )


def open_end_sentence(profile: ProfileLikelihood) -> str | None:
    """What the data leave open of one sigma, prior left out; None where they bound it from both sides."""
    low, high = profile.likelihood_interval_95
    if low is not None and high is not None:
        return None
    if high is not None:
        return (
            f"The data bound {profile.component} only from above: below {high:.2g}, 95 %; the prior keeps it from zero."
        )
    if low is not None:
        return f"The data bound {profile.component} only from below: above {low:.2g}, 95 %; the prior keeps it finite."
    return f"The data do not bound {profile.component}: its interval is the prior's."


@dataclasses.dataclass(frozen=True)
class _Path:
    """Points of every profile: a' theta, f, the likelihood's part of f, and whether the minimiser converged."""

    at: Float[np.ndarray, "d g"]
    value: Float[np.ndarray, "d g"]
    likelihood: Float[np.ndarray, "d g"]
    converged: Bool[np.ndarray, "d g"]


def _picks(free: Bool[np.ndarray, "n"]) -> dict[str, Float[np.ndarray, "n"]]:
    """Directions in log sigma: the model's components, and the means of the groups that it has."""
    picks = {name: np.eye(N_COMPONENTS)[i] for i, name in enumerate(COMPONENTS) if free[i]}
    for name, members in GROUPS.items():
        if free[members].all():
            picks[name] = np.zeros(N_COMPONENTS)
            picks[name][members] = 1.0 / 3.0
    return picks


@jax.jit
def _paths(
    found: Contrasts,
    prior: Prior,
    theta: Float[Array, "n"],
    covariance: Float[Array, "n n"],
    pick: Float[Array, "d n"],
    reach: Float[Array, "d"],
) -> tuple[Array, Array, Array, Array]:
    """Every point of every profile, started where Laplace's normal expects it."""
    data_alone = Prior(prior.mean, jnp.zeros_like(prior.precision), prior.free)

    def point(pick: Array, offset: Array) -> tuple[Array, Array, Array, Array]:
        spread = covariance @ pick
        best, value, converged = _best_with_held(found, prior, pick, theta + spread * offset / (pick @ spread))
        return pick @ best, value, negative_log_posterior(best, (found, data_alone)), converged

    offset = jnp.linspace(-1.0, 1.0, POINTS)[None] * reach[:, None]
    return jax.vmap(lambda a, row: jax.vmap(lambda o: point(a, o))(row))(pick, offset)


def _best_with_held(
    found: Contrasts, prior: Prior, pick: Float[Array, "n"], start: Float[Array, "n"]
) -> tuple[Float[Array, "n"], Float[Array, ""], Bool[Array, ""]]:
    """Optimum over the free log sigmas with `pick' theta` as at the start, its value, and whether it was found."""
    tangent = jnp.diag(prior.free) - jnp.outer(pick, pick) / (pick @ pick)
    # The likelihood may curve down or not at all; the weakest prior is the least that a direction curves.
    floor = 0.5 * jnp.min(jnp.linalg.eigvalsh(prior.precision + jnp.diag(1.0 - prior.free)))
    args = (found, prior)

    def newton(theta: Array) -> tuple[Array, Array, Array]:
        """Value, undamped step, and what it would gain."""
        at = derivatives(theta, args)
        curvature, vector = jnp.linalg.eigh(tangent @ hessian(theta, args) @ tangent)
        slope = vector.T @ (tangent @ at.gradient)
        along = -slope / jnp.maximum(jnp.abs(curvature), floor)
        return at.value, tangent @ (vector @ along), -0.5 * slope @ along

    def again(carry: tuple) -> tuple:
        count, theta, (value, step, gain), damping = carry
        shorter = 1.0 / (1.0 + damping)
        shorter = jnp.minimum(shorter, _LONGEST / jnp.maximum(jnp.max(jnp.abs(step)), 1e-300))
        trial = theta + shorter * step
        there = newton(trial)
        accept = there[0] <= value
        new = jax.tree.map(lambda a, b: jnp.where(accept, a, b), (trial, there), (theta, (value, step, gain)))
        return count + 1, *new, jnp.where(accept, damping / 5.0, damping * 6.0)

    def unsettled(carry: tuple) -> Array:
        count, _, (_, _, gain), damping = carry
        return (count < _MAX_STEPS) & (gain > _ATOL) & (damping < _DAMPING_HIGHEST)

    carry = (jnp.array(0), start, newton(start), jnp.array(_DAMPING_FIRST))
    _, theta, (value, _, gain), _ = jax.lax.while_loop(unsettled, again, carry)
    return theta, value, gain <= _ATOL


def _above_best(value: Float[np.ndarray, "d g"], converged: Bool[np.ndarray, "d g"]) -> Float[np.ndarray, "d g"]:
    """Above each row's lowest; its middle point is the optimum itself, unless a better one turned up beside it."""
    kept = np.where(converged, value, np.inf)
    return np.where(converged, value - kept.min(axis=1, keepdims=True), np.nan)


def _profile(
    name: str, sigma: Float[np.ndarray, "g"], drop: Float[np.ndarray, "g"], alone: Float[np.ndarray, "g"]
) -> ProfileLikelihood:
    return ProfileLikelihood(name, sigma, drop, alone, _interval(sigma, drop), _interval(sigma, alone))


def _interval(sigma: Float[np.ndarray, "g"], drop: Float[np.ndarray, "g"]) -> tuple[float | None, float | None]:
    """Where the drop passes 1.92 on either side of its lowest point: linear in its root, as if normal."""
    kept = np.isfinite(drop)
    if not kept.any():
        return None, None
    log_sigma, root = np.log(sigma[kept]), np.sqrt(np.maximum(drop[kept], 0.0))
    lowest = int(np.argmin(root))
    ends = []
    for step in (-1, 1):
        side = np.arange(lowest, len(root) if step > 0 else -1, step)
        beyond = np.flatnonzero(root[side] >= np.sqrt(DROP_95))
        if not len(beyond):
            ends.append(None)
            continue
        here, there = side[beyond[0] - 1], side[beyond[0]]
        share = (np.sqrt(DROP_95) - root[here]) / (root[there] - root[here])
        ends.append(float(np.exp(log_sigma[here] + share * (log_sigma[there] - log_sigma[here]))))
    return ends[0], ends[1]
