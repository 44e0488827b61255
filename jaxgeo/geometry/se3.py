"""SE(3) on batches of poses, through jaxlie: quaternions are wxyz, tangents are (translation, rotation).

`Exp` and `Log` are written out here because jaxlie 1.5 is not exact in two places: below |w| = 1e-5 rad its `SE3.exp`
takes R for the left Jacobian V, so that the translation is off by |w x v| / 2 and the derivative at w = 0 by half of
its rotation column; and its `SO3.log` drops the derivative by the quaternion's real part within 1e-10 of half a turn.
"""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import jax
import jax.numpy as jnp
from jaxlie import SE3, SO3
from jaxtyping import Array, Float

_SERIES_BELOW = 1e-2  # theta^2 under which four terms of a series beat the closed form: the next one is below 1e-15


_P = ParamSpec("_P")
_R = TypeVar("_R")


def _through_jaxlie(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let jaxlie multiply integers with floats and mix ranks, while JAX stays strict for everyone else."""

    @functools.wraps(function)
    def wrapped(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            return function(*args, **kwargs)

    return wrapped


def hat(v: Float[Array, "*b 3"]) -> Float[Array, "*b 3 3"]:
    """The matrix of the cross product: `hat(v) @ u = v x u`."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    o = jnp.zeros_like(x)
    return jnp.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*v.shape[:-1], 3, 3)


@_through_jaxlie
def so3_exp(rotvec_rad: Float[Array, "*b 3"]) -> Float[Array, "*b 4"]:
    """Quaternion wxyz of a rotation vector."""
    return SO3.exp(rotvec_rad).wxyz


def so3_log(quat_wxyz: Float[Array, "*b 4"]) -> Float[Array, "*b 3"]:
    """Rotation vector, at most pi long, of a quaternion of any length and either sign."""
    quat = quat_wxyz * jnp.where(quat_wxyz[..., :1] < 0.0, -1.0, 1.0)
    w, v = quat[..., 0], quat[..., 1:]
    v_squared = jnp.sum(v * v, axis=-1)
    small = v_squared < 1e-4 * w * w
    u = jnp.where(small, v_squared, 0.0) / jnp.where(small, w * w, 1.0)
    series = 2.0 / jnp.where(small, w, 1.0) * (1.0 - u / 3.0 + u**2 / 5.0 - u**3 / 7.0)
    norm = jnp.sqrt(jnp.where(small, 1.0, v_squared))
    return jnp.where(small, series, 2.0 * jnp.arctan2(norm, w) / norm)[..., None] * v


@_through_jaxlie
def so3_matrix(quat_wxyz: Float[Array, "*b 4"]) -> Float[Array, "*b 3 3"]:
    """Rotation matrix of a quaternion of any length."""
    return SO3(quat_wxyz).as_matrix()


@_through_jaxlie
def so3_from_matrix(matrix: Float[Array, "*b 3 3"]) -> Float[Array, "*b 4"]:
    """Quaternion wxyz of a rotation matrix."""
    return SO3.from_matrix(matrix).wxyz


@_through_jaxlie
def so3_multiply(quat_a_wxyz: Float[Array, "*#b 4"], quat_b_wxyz: Float[Array, "*#b 4"]) -> Float[Array, "*b 4"]:
    """Quaternion product a b; leading axes are broadcast."""
    return (SO3(quat_a_wxyz) @ SO3(quat_b_wxyz)).wxyz


def so3_left_jacobian(rotvec_rad: Float[Array, "*b 3"]) -> Float[Array, "*b 3 3"]:
    """V of `Exp(v, w) = (R, V v)`: I + (1 - cos)/th^2 W + (th - sin)/th^3 W^2 (Barfoot 2017, eq. 7.37)."""
    t2 = jnp.sum(rotvec_rad * rotvec_rad, axis=-1)
    small = t2 < _SERIES_BELOW
    s2 = jnp.where(small, t2, 0.0)
    theta = jnp.sqrt(jnp.where(small, 1.0, t2))
    b_closed = 2.0 * (jnp.sin(0.5 * theta) / theta) ** 2
    c_closed = (theta - jnp.sin(theta)) / theta**3
    b = jnp.where(small, 0.5 - s2 / 24.0 + s2**2 / 720.0 - s2**3 / 40320.0, b_closed)
    c = jnp.where(small, 1.0 / 6.0 - s2 / 120.0 + s2**2 / 5040.0 - s2**3 / 362880.0, c_closed)
    return _polynomial_in_hat(rotvec_rad, b, c)


def so3_left_jacobian_inverse(rotvec_rad: Float[Array, "*b 3"]) -> Float[Array, "*b 3 3"]:
    """V^-1: I - W/2 + (1 - h cot h)/th^2 W^2, h half the angle (Barfoot 2017, eq. 7.38); regular at half a turn."""
    t2 = jnp.sum(rotvec_rad * rotvec_rad, axis=-1)
    small = t2 < _SERIES_BELOW
    s2 = jnp.where(small, t2, 0.0)
    half = 0.5 * jnp.sqrt(jnp.where(small, 1.0, t2))
    closed = (1.0 - half * jnp.cos(half) / jnp.sin(half)) / (4.0 * half**2)
    c = jnp.where(small, 1.0 / 12.0 + s2 / 720.0 + s2**2 / 30240.0 + s2**3 / 1209600.0, closed)
    return _polynomial_in_hat(rotvec_rad, jnp.full_like(c, -0.5), c)


def _polynomial_in_hat(w: Float[Array, "*b 3"], b: Float[Array, "*b"], c: Float[Array, "*b"]) -> Float[Array, "*b 3 3"]:
    matrix = hat(w)
    eye = jnp.broadcast_to(jnp.eye(3), matrix.shape)
    return eye + b[..., None, None] * matrix + c[..., None, None] * (matrix @ matrix)


def se3_from(position_m: Float[Array, "*b 3"], quat_wxyz: Float[Array, "*b 4"]) -> SE3:
    """Poses from positions and unit quaternions of the same leading axes."""
    return SE3(jnp.concatenate([quat_wxyz, position_m], axis=-1))


def se3_parts(pose: SE3) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 4"]]:
    """Positions and quaternions (wxyz)."""
    return pose.wxyz_xyz[..., 4:], pose.wxyz_xyz[..., :4]


def se3_exp(tangent: Float[Array, "*b 6"]) -> SE3:
    """Pose of a tangent (translation, rotation)."""
    rotvec = tangent[..., 3:]
    translation = jnp.einsum("...ij,...j->...i", so3_left_jacobian(rotvec), tangent[..., :3])
    return se3_from(translation, so3_exp(rotvec))


def se3_log(pose: SE3) -> Float[Array, "*b 6"]:
    """Tangent (translation, rotation) of a pose, its rotation at most half a turn."""
    position, quat = se3_parts(pose)
    rotvec = so3_log(quat)
    translation = jnp.einsum("...ij,...j->...i", so3_left_jacobian_inverse(rotvec), position)
    return jnp.concatenate([translation, rotvec], axis=-1)


@_through_jaxlie
def se3_compose(a: SE3, b: SE3) -> SE3:
    """`T_a_b T_b_c`; leading axes are broadcast."""
    return a @ b


@_through_jaxlie
def se3_inverse(pose: SE3) -> SE3:
    """`T_b_a` of `T_a_b`."""
    return pose.inverse()


@_through_jaxlie
def se3_relative(a: SE3, b: SE3) -> SE3:
    """`T_a^-1 T_b`: pose b seen from pose a."""
    return a.inverse() @ b


@_through_jaxlie
def se3_apply(pose: SE3, point_m: Float[Array, "*b 3"]) -> Float[Array, "*b 3"]:
    """`R x + t`; leading axes are broadcast."""
    return pose @ point_m


@_through_jaxlie
def se3_adjoint(pose: SE3) -> Float[Array, "*b 6 6"]:
    """Ad of `T Exp(x) T^-1 = Exp(Ad x)`: [[R, hat(t) R], [0, R]], order (translation, rotation)."""
    return pose.adjoint()
