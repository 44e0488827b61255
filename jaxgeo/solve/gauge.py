"""Do the anchors fix the frame? Six degrees of freedom, checked before anything is solved.

Three position anchors off one line do; two do not, nor do any number on a line: the turn about it stays free.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# A frame whose weakest turn is known no better than this is called undetermined: beyond it, linearising means nothing.
WEAKEST_TURN_RAD = 0.35


def gauge_covariance(
    point_m: Float[Array, "k 3"],
    sqrt_information: Float[Array, "k 3 3"],
    rotation_information: Float[Array, "k 3 3"],
) -> tuple[Float[Array, "6"], Float[Array, "6 6"]]:
    """Standard deviations of the frame's weakest to strongest directions, and those directions as columns.

    From the anchors alone, were the trajectory rigid; about the anchors' centre, rotations in radians times the
    anchors' spread, so that all are lengths. An infinite one is a direction left free. Held-out anchors have zero
    information.
    """
    weight = jnp.sum(sqrt_information**2, axis=(-2, -1))
    share = weight / jnp.maximum(jnp.sum(weight), 1e-300)
    centre = share @ point_m
    arm = jnp.where((weight > 0)[:, None], point_m - centre[None], 0.0)
    spread = jnp.sqrt(jnp.maximum(share @ jnp.sum(arm * arm, axis=-1), 1e-12))
    z = jnp.zeros_like(arm[:, 0])
    rows = [z, arm[:, 2], -arm[:, 1], -arm[:, 2], z, arm[:, 0], arm[:, 1], -arm[:, 0], z]
    turn = jnp.stack(rows, axis=-1).reshape(-1, 3, 3) / spread
    jacobian = jnp.concatenate([jnp.broadcast_to(jnp.eye(3), turn.shape), turn], axis=-1)
    whitened = sqrt_information @ jacobian
    information = jnp.einsum("kda,kdb->ab", whitened, whitened)
    information = information.at[3:, 3:].add(rotation_information.sum(axis=0) / spread**2)
    value, vector = jnp.linalg.eigh(information)
    largest = jnp.maximum(value[-1], 1e-300)
    sigma = jnp.where(value > 1e-13 * largest, 1.0 / jnp.sqrt(jnp.maximum(value, 1e-300)), jnp.inf)
    turning = jnp.sum(vector[3:] ** 2, axis=0) > 0.5
    return jnp.where(turning, sigma / spread, sigma), vector


def determined(sigma: Float[Array, "6"], vector: Float[Array, "6 6"]) -> Array:
    """Whether every turn is known better than `WEAKEST_TURN_RAD` and every shift is known at all."""
    turning = jnp.sum(vector[3:] ** 2, axis=0) > 0.5
    return jnp.all(jnp.where(turning, sigma < WEAKEST_TURN_RAD, jnp.isfinite(sigma)))


def free_direction_words(sigma: np.ndarray, vector: np.ndarray) -> str:
    """The weakest direction in words, for the error message."""
    weakest = int(np.argmax(np.where(np.isfinite(sigma), sigma, 1e300)))
    shift, turn = vector[:3, weakest], vector[3:, weakest]
    axis = turn if np.sum(turn**2) > 0.5 else shift
    axis = axis / np.linalg.norm(axis)
    axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
    direction = f"(E {axis[0]:.2f}, N {axis[1]:.2f}, h {axis[2]:.2f})"
    size = (
        "wholly" if not np.isfinite(sigma[weakest]) else f"known to {np.degrees(sigma[weakest]):.0f} degrees only, i.e."
    )
    if np.sum(turn**2) > 0.5:
        return f"the turn about the direction {direction} is {size} free"
    return f"the shift along {direction} is free"
