"""Minimise a restricted likelihood by average information and a secant: an optimistix minimiser.

The average information is half of the Hessian to twice it along some directions, on which steps with it alone overshoot
or creep (100 steps on real sessions). What it lacks is learned from the gradients' differences, as NL2SOL does for what
Gauss-Newton lacks (Dennis, Gay and Welsch 1981): the correction E is the least change for which (information + E) step
equals the gradient's difference.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree

from calibration.reml import Derivatives, derivatives

# A step changes no sigma by more than this factor (e^1.5), so that a flat likelihood is not overshot.
_LONGEST = 1.5
_DAMPING_FIRST = 0.3
_DAMPING_HIGHEST = 1e8


class State(eqx.Module):
    """The last accepted point's derivatives and what to try next."""

    at: Derivatives
    correction: Float[Array, "n n"]
    damping: Float[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]


def _step(state: State) -> Float[Array, "n"]:
    """The damped step; with the average information alone where the correction points uphill."""
    information, gradient = state.at.information, state.at.gradient
    damping = state.damping * jnp.diag(jnp.diagonal(information))
    corrected = -jnp.linalg.solve(information + state.correction + damping, gradient)
    plain = -jnp.linalg.solve(information + damping, gradient)
    # As far downhill as it should go, and no farther than ten times the plain step.
    good = (corrected @ gradient < 0.1 * (plain @ gradient)) & (corrected @ corrected < 100.0 * (plain @ plain))
    return jnp.clip(jnp.where(good, corrected, plain), -_LONGEST, _LONGEST)


def _corrected(state: State, trial: Derivatives, step: Float[Array, "n"]) -> Float[Array, "n n"]:
    """The least change of the correction that fits how the gradient changed; none where it did not rise."""
    change = trial.gradient - state.at.gradient
    along = change @ step
    rest = change - (trial.information + state.correction) @ step
    safe = along > 1e-8 * jnp.sqrt((change @ change) * (step @ step))
    scale = jnp.where(safe, 1.0 / jnp.where(safe, along, 1.0), 0.0)
    both = jnp.outer(rest, change)
    return state.correction + scale * (both + both.T) - scale**2 * (rest @ step) * jnp.outer(change, change)


class AverageInformation(optx.AbstractMinimiser):
    """Quasi-Newton steps with the average information, the prior's precision and a secant correction as the Hessian.

    `args` must be the `(Contrasts, Prior)` of `reml`. Converged: the expected decrease of a step, undamped, is below
    `atol`; a nat is a unit of log-likelihood, so the answer is within the square root of it of the optimum, in standard
    deviations of the estimate.
    """

    rtol: float = 0.0
    atol: float = 1e-7
    norm: Callable[[PyTree], Array] = optx.max_norm

    def init(
        self, fn: Any, y: Array, args: Any, options: dict, f_struct: Any, aux_struct: Any, tags: frozenset
    ) -> State:
        at = derivatives(y, args)
        nothing = jnp.zeros_like(at.information)
        return State(at, nothing, jnp.array(_DAMPING_FIRST), self._settled(at), jnp.array(False))

    def _settled(self, at: Derivatives) -> Bool[Array, ""]:
        return at.gradient @ jnp.linalg.solve(at.information, at.gradient) <= 2.0 * self.atol

    def step(self, fn: Any, y: Array, args: Any, options: dict, state: State, tags: frozenset) -> tuple:
        step = _step(state)
        trial = derivatives(y + step, args)
        finite = jnp.isfinite(trial.value)
        # At the optimum rounding may raise the value by a hair.
        accept = finite & (trial.value <= state.at.value + 1e-13 * jnp.abs(state.at.value))
        correction = jnp.where(finite, _corrected(state, trial, step), state.correction)
        at = jax.tree.map(lambda new, old: jnp.where(accept, new, old), trial, state.at)
        damping = jnp.where(accept, state.damping / 8.0, jnp.maximum(state.damping * 8.0, 1e-3))
        stuck = damping > _DAMPING_HIGHEST
        return jnp.where(accept, y + step, y), State(at, correction, damping, self._settled(at), stuck), None

    def terminate(
        self, fn: Any, y: Array, args: Any, options: dict, state: State, tags: frozenset
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        result = optx.RESULTS.where(
            state.stuck & ~state.converged, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful
        )
        return state.converged | state.stuck, result

    def postprocess(
        self, fn: Any, y: Array, aux: Any, args: Any, options: dict, state: State, tags: frozenset, result: Any
    ) -> tuple[Array, Any, dict[str, Any]]:
        return y, aux, {}
