"""The components of odometry noise: every way in which a trajectory's drift can grow, each with one standard deviation.

    white        drawn anew on every edge: per body axis by distance, and rotation by turned angle
    constant     drawn once: scale along the motion, scale of the turns, bias per metre
    wander       a bias per metre, or a scale, that changes slowly: Gauss-Markov over distance (Ornstein and Uhlenbeck)
    bounded      a position error that does not grow: the Gauss-Markov error of a loop-closed trajectory
    anchor       a common factor on what the anchors' own covariances say; only where it is freed

The components' effects add, so the covariance of the anchors is a sum of one positive matrix each, times sigma^2.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgeo.graph.noise import OdometryNoise

COMPONENTS: tuple[str, ...] = (
    "trans_x_m_per_sqrt_m",
    "trans_y_m_per_sqrt_m",
    "trans_z_m_per_sqrt_m",
    "rot_x_rad_per_sqrt_m",
    "rot_y_rad_per_sqrt_m",
    "rot_z_rad_per_sqrt_m",
    "turn_rad_per_sqrt_rad",
    "log_scale",
    "log_turn",
    "bias_trans_m_per_m",
    "bias_rot_rad_per_m",
    "wander_log_scale",
    "wander_trans_m_per_m",
    "wander_rot_rad_per_m",
    "bounded_m",
    "anchor_factor",
)
N_COMPONENTS = len(COMPONENTS)
N_WHITE = 7
# Where the groups begin and end in COMPONENTS.
TRANS, ROT, TURN = slice(0, 3), slice(3, 6), 6
LOG_SCALE, LOG_TURN, BIAS_TRANS, BIAS_ROT = 7, 8, 9, 10
WANDER_SCALE, WANDER_TRANS, WANDER_ROT = 11, 12, 13
BOUNDED, ANCHOR = 14, 15


class NoiseEnsemble(eqx.Module):
    """What is known of a trajectory's noise: weighted sets of standard deviations, one per component.

    One set of weight 1 is a fixed noise. Predictions are means over the sets, and their covariance has the spread
    between the sets in it.

    Attributes:
        sigma: (q, n) standard deviations in the order of `COMPONENTS`, 0 where a component is left out.
        weight: (q,) non-negative, sum 1.
        correlation_m: () distance over which wander and bounded error forget.
    """

    sigma: Float[Array, "q n"]
    weight: Float[Array, "q"]
    correlation_m: Float[Array, ""]


def ensemble_of(noise: OdometryNoise, correlation_m: float = 1.0) -> NoiseEnsemble:
    """A fixed noise as an ensemble of one; the bias of three axes becomes one of their root mean square."""

    def rms(x: Array) -> Array:
        mean = jnp.mean(x * x)
        return jnp.where(mean > 0, jnp.sqrt(jnp.where(mean > 0, mean, 1.0)), 0.0)

    sigma = jnp.zeros(N_COMPONENTS)
    sigma = sigma.at[TRANS].set(noise.sigma_trans_m_per_sqrt_m).at[ROT].set(noise.sigma_rot_rad_per_sqrt_m)
    sigma = sigma.at[TURN].set(noise.sigma_turn_rad_per_sqrt_rad).at[LOG_SCALE].set(noise.sigma_log_scale)
    sigma = sigma.at[BIAS_TRANS].set(rms(noise.sigma_bias_trans_m_per_m))
    sigma = sigma.at[BIAS_ROT].set(rms(noise.sigma_bias_rot_rad_per_m))
    return NoiseEnsemble(sigma[None], jnp.ones(1), jnp.asarray(correlation_m, dtype=jnp.float64))


def white_noise_of(sigma: Float[np.ndarray, "n"]) -> OdometryNoise:
    """The part of one set that `OdometryNoise` can say: white, log-scale and constant bias."""
    s = jnp.asarray(sigma, dtype=jnp.float64)
    three = jnp.ones(3)
    return OdometryNoise(s[TRANS], s[ROT], s[TURN], s[LOG_SCALE], three * s[BIAS_TRANS], three * s[BIAS_ROT])
