"""Fit every model of the family, weigh them by what they foretell, and spread each over its own uncertainty.

A model's weight is the geometric mean of two probabilities of the data: its Laplace evidence, and the likelihood with
which it predicts each location from all the others. Evidence alone is sure too soon where no model is quite right; on
simulated sessions and on layouts drawn from real ones the mean of the two did best.

The posterior of a model is taken as normal about its optimum, then corrected: a fixed set of low-discrepancy draws
from that normal is weighted by the true posterior over the normal's density. The draws of all models, weighted by the
models' evidence, are the ensemble under which the trajectory is predicted.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float
from scipy.stats import norm, qmc

from calibration.average_information import AverageInformation
from calibration.reml import Contrasts, Prior, hessian, log_predictive, negative_log_posterior
from jaxgeo.graph.components import N_COMPONENTS

DRAWS = 16
MAX_STEPS = 60
# Starts: the prior's median, and all sigmas e^1.5 times larger and smaller.
STARTS = (0.0, 1.5, -1.5)
# A draw's weight is at most e^3 times the median draw's: one draw in a far tail must not decide.
_HEAVIEST = 3.0
_SOLVER = AverageInformation()


def _normal_draws() -> Float[np.ndarray, "draws n"]:
    sobol = qmc.Sobol(N_COMPONENTS, scramble=True, rng=np.random.default_rng(0))
    return norm.ppf(sobol.random(DRAWS))


_NORMAL = _normal_draws()


class ModelFit(eqx.Module):
    """One model's posterior of theta = log sigma.

    Attributes:
        theta: (n,) the optimum; meaningless where the model does not have the component.
        covariance: (n, n) Laplace; zero where not in the model.
        log_evidence: Laplace, up to what all models share; `log_predictive` leave one location out, at the optimum.
        draws, log_weight: (draws, n) and (draws,) of the corrected normal.
        converged: ().
    """

    theta: Float[Array, "n"]
    covariance: Float[Array, "n n"]
    log_evidence: Float[Array, ""]
    log_predictive: Float[Array, ""]
    draws: Float[Array, "draws n"]
    log_weight: Float[Array, "draws"]
    converged: Bool[Array, ""]


def minimise(found: Contrasts, prior: Prior, start: Float[Array, "n"]) -> tuple[Array, Array, Array]:
    """Optimum, its value and whether it converged."""
    solution = optx.minimise(negative_log_posterior, _SOLVER, start, (found, prior), max_steps=MAX_STEPS, throw=False)
    return solution.value, solution.state.at.value, solution.result == optx.RESULTS.successful


def fit_from(found: Contrasts, prior: Prior, starts: Float[Array, "s n"]) -> tuple[Array, Array, Array]:
    """The best optimum of several starts."""
    theta, value, converged = jax.vmap(lambda start: minimise(found, prior, start))(starts)
    best = jnp.argmin(jnp.where(jnp.isfinite(value) & converged, value, jnp.inf))
    return theta[best], value[best], converged[best]


def laplace(found: Contrasts, prior: Prior, theta: Array, value: Array, converged: Array) -> ModelFit:
    """Covariance, evidence and draws about an optimum."""
    args = (found, prior)
    values, vectors = jnp.linalg.eigh(hessian(theta, args))
    # The likelihood alone may curve down along a sigma it cannot see; half the weakest prior keeps the normal proper.
    curvature = jnp.maximum(values, 0.5 * jnp.min(jnp.linalg.eigvalsh(prior.precision + jnp.diag(1.0 - prior.free))))
    free = prior.free[:, None] * prior.free[None]
    covariance = (vectors / curvature[None]) @ vectors.T * free
    log_evidence = -value - 0.5 * jnp.sum(jnp.log(curvature))
    own = prior.precision + jnp.diag(1.0 - prior.free)
    log_evidence = log_evidence + jnp.sum(jnp.log(jnp.diagonal(jnp.linalg.cholesky(own))))
    spread = (vectors / jnp.sqrt(curvature)[None]) @ vectors.T * free
    z = jnp.asarray(_NORMAL) * prior.free[None]
    draws = theta[None] + z @ spread
    log_weight = -jax.vmap(lambda t: negative_log_posterior(t, args))(draws) + 0.5 * jnp.sum(z * z, axis=1)
    log_weight = jnp.where(jnp.isfinite(log_weight), log_weight, -jnp.inf)
    log_weight = jnp.minimum(log_weight, jnp.median(log_weight) + _HEAVIEST)
    log_weight = log_weight - jax.scipy.special.logsumexp(log_weight)
    return ModelFit(theta, covariance, log_evidence, log_predictive(theta, args), draws, log_weight, converged)


def fit_family(found: Contrasts, priors: Prior, starts: Float[Array, "models s n"]) -> ModelFit:
    """Every model (leading axis of `priors` and `starts`)."""

    def one(prior: Prior, own_starts: Array) -> ModelFit:
        return laplace(found, prior, *fit_from(found, prior, own_starts))

    return jax.vmap(one)(priors, starts)


def model_weights(fit: ModelFit) -> Float[Array, "models"]:
    """Weight of every model, all equally likely before; one that did not converge has none."""
    score = 0.5 * (fit.log_evidence + fit.log_predictive)
    return jax.nn.softmax(jnp.where(fit.converged, score, -jnp.inf))
