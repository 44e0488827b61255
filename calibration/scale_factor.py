"""The surveyor's variance of unit weight: the fixed noise times one factor, from the misclosures in closed form.

With the contrasts c ~ N(0, M), M = R + s^2 V, V the fixed noise's, R the anchors' own covariance, and r their number,

    s^2 = c' M^-1 c / r                                          with s = 1 in M

is the a-posteriori variance factor of adjustment theory (Koch, Parameter Estimation and Hypothesis Testing in Linear
Models, 1999, section 3.2.4). It scales R with V, so one step of the estimator of Foerstner (1979) follows, which
holds R:

    s^2 <- s^2 (c' M^-1 V M^-1 c) / tr(M^-1 V)                   with s^2 in M

Repeated for ever that is restricted maximum likelihood of the one factor. The ratios between the sigmas stay as the
fixed noise has them: that is what this baseline cannot learn.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.baselines import Given, scaled_noise
from calibration.reml import Contrasts
from jaxgeo.graph.components import ensemble_of
from jaxgeo.graph.noise import OdometryNoise

ITERATIONS = 1
# Contrasts that contradict nothing would say that there is no noise.
_SMALLEST = 1e-8


def scale_factor(found: Contrasts, sigma: Float[Array, "n"], iterations: int = ITERATIONS) -> Float[Array, ""]:
    """The factor s on the standard deviations `sigma`; 1 where there is nothing to learn from."""
    of_noise = jnp.einsum("c,cxy->xy", sigma**2, found.components)

    def solved(square: Array) -> tuple[Array, Array]:
        factor = (jnp.linalg.cholesky(found.base + square * of_noise), True)
        return jax.scipy.linalg.cho_solve(factor, found.c), jax.scipy.linalg.cho_solve(factor, of_noise)

    square = found.c @ solved(jnp.ones(()))[0] / jnp.maximum(found.count, 1.0)
    for _ in range(iterations):
        square = jnp.maximum(square, _SMALLEST)
        y, influence = solved(square)
        square = square * (y @ of_noise @ y) / jnp.maximum(jnp.trace(influence), 1e-300)
    return jnp.sqrt(jnp.where(found.count > 0, jnp.maximum(square, _SMALLEST), 1.0))


def scale_factor_noise(given: Given) -> OdometryNoise:
    """The fixed noise times the factor: an estimator for `estimated_folds`."""
    s = scale_factor(given.found, ensemble_of(given.noise).sigma[0])
    return scaled_noise(given.noise, s, s, s)
