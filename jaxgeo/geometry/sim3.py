"""Similarities of space: `x -> scale R x + t`."""

from typing import Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.geometry.se3 import so3_from_matrix, so3_multiply


class Sim3(eqx.Module):
    """One similarity `T_a_b`: maps points of b into a. For many, `jax.vmap`.

    Attributes:
        scale: positive, metres of a in a metre of b.
        rotation: (3, 3) b to a.
        translation_m: (3,) in a.
    """

    scale: Float[Array, ""]
    rotation: Float[Array, "3 3"]
    translation_m: Float[Array, "3"]

    @classmethod
    def identity(cls) -> Self:
        return cls(jnp.ones(()), jnp.eye(3), jnp.zeros(3))


def sim3_apply(sim3: Sim3, point_m: Float[Array, "*b 3"]) -> Float[Array, "*b 3"]:
    """`scale R x + t` of any number of points."""
    moved = sim3.scale * jnp.einsum("ij,...j->...i", sim3.rotation, point_m)
    return moved + jnp.broadcast_to(sim3.translation_m, moved.shape)


def sim3_compose(a: Sim3, b: Sim3) -> Sim3:
    """`T_a_b T_b_c`: first b, then a."""
    return Sim3(a.scale * b.scale, a.rotation @ b.rotation, sim3_apply(a, b.translation_m))


def sim3_inverse(sim3: Sim3) -> Sim3:
    """`T_b_a` of `T_a_b`."""
    rotation = sim3.rotation.T
    return Sim3(1.0 / sim3.scale, rotation, -(rotation @ sim3.translation_m) / sim3.scale)


def sim3_apply_poses(
    sim3: Sim3, position_m: Float[Array, "*b 3"], quat_wxyz: Float[Array, "*b 4"]
) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 4"]]:
    """Poses of rigid bodies after the similarity: positions scaled, rotations turned only."""
    quat = jnp.broadcast_to(so3_from_matrix(sim3.rotation), quat_wxyz.shape)
    return sim3_apply(sim3, position_m), so3_multiply(quat, quat_wxyz)


def sim3_apply_trajectory(sim3: Sim3, trajectory: Trajectory) -> Trajectory:
    """The whole trajectory in the other frame, stamps unchanged; in NumPy, since every length would compile anew."""
    matrix = np.asarray(sim3.rotation)
    position_m = float(sim3.scale) * trajectory.position_m @ matrix.T + np.asarray(sim3.translation_m)
    turn = Rotation.from_matrix(matrix) * Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    return Trajectory(trajectory.stamp_s, position_m, turn.as_quat(scalar_first=True))
