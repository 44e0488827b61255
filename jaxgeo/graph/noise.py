"""The noise of one trajectory's odometry.

An edge of length d and turn a has white noise of variance `sigma_trans^2 d` (translation) and
`sigma_rot^2 d + sigma_turn^2 a` (rotation), on top of what is drawn once for the whole session: a log-scale and a
constant bias per metre, each with a zero-mean normal prior. A prior of zero leaves that term out.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# A rig that stands still jitters: each edge counts as at least this long.
LENGTH_FLOOR_M = 1e-3


class OdometryNoise(eqx.Module):
    """Standard deviations of the odometry noise, in body axes.

    Attributes:
        sigma_trans_m_per_sqrt_m: (3,) white translation noise.
        sigma_rot_rad_per_sqrt_m: (3,) white rotation noise by distance.
        sigma_turn_rad_per_sqrt_rad: () white rotation noise by turned angle, every axis.
        sigma_log_scale: () prior of the log-scale of the odometry's translations; 0: metric.
        sigma_bias_trans_m_per_m: (3,) prior of the constant translation bias; 0: none.
        sigma_bias_rot_rad_per_m: (3,) prior of the constant rotation bias; 0: none.
    """

    sigma_trans_m_per_sqrt_m: Float[Array, "3"]
    sigma_rot_rad_per_sqrt_m: Float[Array, "3"]
    sigma_turn_rad_per_sqrt_rad: Float[Array, ""]
    sigma_log_scale: Float[Array, ""]
    sigma_bias_trans_m_per_m: Float[Array, "3"]
    sigma_bias_rot_rad_per_m: Float[Array, "3"]


def odometry_noise(
    sigma_trans_m_per_sqrt_m: float | list[float],
    sigma_rot_rad_per_sqrt_m: float | list[float],
    sigma_turn_rad_per_sqrt_rad: float = 0.0,
    sigma_log_scale: float = 0.0,
    sigma_bias_trans_m_per_m: float | list[float] = 0.0,
    sigma_bias_rot_rad_per_m: float | list[float] = 0.0,
) -> OdometryNoise:
    """Noise from plain numbers: a scalar stands for all three axes."""

    def axes(value: float | list[float]) -> Float[Array, "3"]:
        return jnp.asarray(np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)))

    return OdometryNoise(
        axes(sigma_trans_m_per_sqrt_m),
        axes(sigma_rot_rad_per_sqrt_m),
        jnp.asarray(sigma_turn_rad_per_sqrt_rad, dtype=jnp.float64),
        jnp.asarray(sigma_log_scale, dtype=jnp.float64),
        axes(sigma_bias_trans_m_per_m),
        axes(sigma_bias_rot_rad_per_m),
    )


def edge_variances(
    noise: OdometryNoise, length_m: Float[Array, "n"], turn_rad: Float[Array, "n"]
) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
    """White variances of every edge, translation (m^2) and rotation (rad^2), each as three (n,) vectors.

    An edge of length zero (padding) has variance zero.
    """
    turn = noise.sigma_turn_rad_per_sqrt_rad**2 * turn_rad
    trans, rot = noise.sigma_trans_m_per_sqrt_m**2, noise.sigma_rot_rad_per_sqrt_m**2
    return (
        (trans[0] * length_m, trans[1] * length_m, trans[2] * length_m),
        (rot[0] * length_m + turn, rot[1] * length_m + turn, rot[2] * length_m + turn),
    )
