"""One set of variances that stands for a noise on the way: those of a fixed noise, or an ensemble's means.

Every set of an ensemble draws its noise about zero, so that the whole mixture's covariance is that of the mean
variances. Under it kriging gives the best linear prediction, and a covariance that is the mixture's own mean squared
error: honest, if wider than need be. The mean of the sets' predictions, which the batch solve takes, is not linear in
the variances; one set costs an anchor's update a hundredth of what a hundred cost.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgeo.graph.components import (
    ANCHOR,
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    LOG_TURN,
    ROT,
    TRANS,
    TURN,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
    NoiseEnsemble,
)
from jaxgeo.graph.noise import OdometryNoise


class MeanNoise(eqx.Module):
    """Mean variances.

    Attributes:
        white: only its white part is read.
        constant: (8,) of bias per metre (translation, rotation), log-scale and scale of the turns.
        wander: (7,) of wandering bias and scale; `bounded_m2` of the bounded error.
        anchor_factor: what is added to the anchors' own covariances, as a share of them.
        correlation_m: over which wander and bounded error forget.
        turns, forgets: whether the scale of the turns, and wander or bounded error, are there at all.
        pooled: of an ensemble, under which visits of one location share the error of its survey.
    """

    white: OdometryNoise
    constant: Float[Array, "8"]
    wander: Float[Array, "7"]
    bounded_m2: Float[Array, ""]
    anchor_factor: Float[Array, ""]
    correlation_m: Float[Array, ""]
    turns: bool = eqx.field(static=True)
    forgets: bool = eqx.field(static=True)
    pooled: bool = eqx.field(static=True)


def mean_noise(noise: OdometryNoise | NoiseEnsemble) -> MeanNoise:
    """The noise itself where it is fixed; means over the sets of an ensemble."""
    if isinstance(noise, OdometryNoise):
        bias = [noise.sigma_bias_trans_m_per_m, noise.sigma_bias_rot_rad_per_m, noise.sigma_log_scale[None]]
        constant = jnp.concatenate([*bias, jnp.zeros(1)]) ** 2
        zero = jnp.zeros(())
        return MeanNoise(noise, constant, jnp.zeros(7), zero, zero, jnp.ones(()), False, False, False)
    variance = np.asarray(noise.weight) @ np.asarray(noise.sigma) ** 2
    sigma = np.sqrt(variance)
    white = OdometryNoise(
        jnp.asarray(sigma[TRANS]),
        jnp.asarray(sigma[ROT]),
        jnp.asarray(sigma[TURN]),
        jnp.zeros(()),
        jnp.zeros(3),
        jnp.zeros(3),
    )
    constant = np.repeat(variance[[BIAS_TRANS, BIAS_ROT, LOG_SCALE, LOG_TURN]], [3, 3, 1, 1])
    wander = np.repeat(variance[[WANDER_TRANS, WANDER_ROT, WANDER_SCALE]], [3, 3, 1])
    return MeanNoise(
        white,
        jnp.asarray(constant),
        jnp.asarray(wander),
        jnp.asarray(variance[BOUNDED]),
        jnp.asarray(variance[ANCHOR]),
        jnp.asarray(noise.correlation_m),
        turns=bool(variance[LOG_TURN] > 0.0),
        forgets=bool(np.any(wander > 0.0) or variance[BOUNDED] > 0.0),
        pooled=True,
    )
