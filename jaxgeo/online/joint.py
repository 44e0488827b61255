"""What is known together of the last pose and of the noise's constants: where the drift goes on from.

The 24 errors, in this order: position and rotation of the last pose (grid axes; position added, rotation multiplied on
the left), bias per metre (translation, rotation), log-scale, scale of the turns, wander (translation, rotation, scale),
bounded position error.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

POSITION, ROTATION = slice(0, 3), slice(3, 6)
BIAS_TRANS, BIAS_ROT = slice(6, 9), slice(9, 12)
LOG_SCALE, LOG_TURN = 12, 13
WANDER_TRANS, WANDER_ROT, WANDER_SCALE = slice(14, 17), slice(17, 20), 20
BOUNDED = slice(21, 24)
N_ERRORS = 24


class LastPose(eqx.Module):
    """The last pose of a solved chain, local frame, with the noise's constants.

    Attributes:
        position_m, quat_wxyz: without the bounded error.
        constants: (18,) of the errors from the bias on, their estimates.
        covariance: (24, 24) of all errors.
    """

    position_m: Float[Array, "3"]
    quat_wxyz: Float[Array, "4"]
    constants: Float[Array, "18"]
    covariance: Float[Array, "24 24"]


def conditioned(
    prior: Float[Array, "e e"],
    cross: Float[Array, "e m"],
    lever: Float[Array, "e 6"],
    factor: Float[Array, "m m"],
    whitened_gauge: Float[Array, "m 6"],
    gauge_covariance: Float[Array, "6 6"],
) -> tuple[Float[Array, "e e"], Float[Array, "e m"]]:
    """Posterior covariance of errors e, and their cross covariance whitened by the anchors' factor.

    With C the prior covariance of e with the anchors' rows and L how e moves with the gauge (universal kriging):

        prior - C M^-1 C' + X (H_0' M^-1 H_0)^-1 X',      X = L - C M^-1 H_0
    """
    whitened = jax.scipy.linalg.solve_triangular(factor, cross.T, lower=True).T
    moved = lever - whitened @ whitened_gauge
    covariance = prior - whitened @ whitened.T + moved @ gauge_covariance @ moved.T
    return 0.5 * (covariance + covariance.T), whitened


def at_pose(position_m: Float[Array, "3"], covariance: Float[Array, "e e"]) -> Float[Array, "e e"]:
    """From increments about the origin (the first six) to errors at the pose itself: dp = dt + dr x p."""
    x, y, z = position_m[0], position_m[1], position_m[2]
    zero = jnp.zeros(())
    hat = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    shift = jnp.eye(covariance.shape[0]).at[POSITION, ROTATION].set(-hat)
    return shift @ covariance @ shift.T
