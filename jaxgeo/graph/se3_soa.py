"""Exponential, logarithm and right Jacobian of SE(3) on component tuples (see `soa`).

Formulas: Barfoot, State Estimation for Robotics (2017), section 7.1 and (7.86); the products of skew matrices in
(7.86b) are reduced with W V W = -(w.v) W and u w' - w u' = [w x u], which leaves no 3x3 product.

Every coefficient is an entire function of the squared angle, summed as its power series: no branch at zero angle,
finite gradients of every order, and 5 times cheaper in float64 than sine and cosine, which XLA does not vectorise on
CPUs. Each function is a `jit` of its own: traced once for all its uses in a program.
The series hold to 1e-15 for angles up to pi (`exp`: up to 2 pi); the logarithm halves the angle three times
first.
"""

from functools import partial
from math import factorial

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxgeo.graph.soa import Mat3, Quat, Vec3, add, cross, dot, mat_add, matvec, scale, sub, transpose

# Terms of a power series in the squared angle that reach 1e-16 at an angle of pi.
TERMS = 14
# Below this squared angle the coefficient of `log` that divides by it switches to its series (0.25 rad).
SERIES_BELOW_RAD2 = 0.0625


def _alternating(shift: int) -> tuple[float, ...]:
    """Coefficients of `sum_i (-x)^i / (2 i + shift)!`: cos (0), sin a / a (1), (1 - cos a) / a^2 (2), ..."""
    return tuple((-1) ** i / factorial(2 * i + shift) for i in range(TERMS))


_COS, _SINC, _B, _C2 = (_alternating(shift) for shift in range(4))
# (a^2 + 2 cos a - 2) / (2 a^4) and (2 a - 3 sin a + a cos a) / (2 a^5)
_C3 = _alternating(4)
_C4 = tuple((-1) ** i * (i + 1) / factorial(2 * i + 5) for i in range(TERMS))
_ATAN = tuple((-1) ** i / (2 * i + 1) for i in range(12))
# (1 - (a/2) cot(a/2)) / a^2
_LOG_B = (1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000)


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def _series(x: Array, coefficients: tuple[float, ...]) -> Array:
    """Horner's rule. Its derivative is the derived series: differentiating the rule makes XLA repeat its steps."""
    total = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * x + c
    return total


@_series.defjvp
def _series_jvp(coefficients: tuple[float, ...], primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (x,), (dx,) = primals, tangents
    derived = tuple(i * c for i, c in enumerate(coefficients))[1:]
    return _series(x, coefficients), _series(x, derived) * dx


@jax.jit
def exp(translation: Vec3, rotation: Vec3) -> tuple[Quat, Vec3]:
    """`Exp(translation, rotation)` as unit quaternion and translation, angle up to 2 pi."""
    t2 = dot(rotation, rotation)
    quarter = 0.25 * t2
    s = 0.5 * _series(quarter, _SINC)
    c = _series(quarter, _COS)
    once = cross(rotation, translation)
    twice = cross(rotation, once)
    # (1 - cos a) / a^2 = 2 (sin(a/2) / a)^2
    moved = add(translation, add(scale(2.0 * s * s, once), scale(_series(t2, _C2), twice)))
    return (c, s * rotation[0], s * rotation[1], s * rotation[2]), moved


@jax.jit
def log(q: Quat, translation: Vec3) -> tuple[Vec3, Vec3]:
    """`Log` of a pose as (translation, rotation), rotation angle in [0, pi]."""
    sign = jnp.where(q[0] < 0, -1.0, 1.0)
    w = sign * q[0]
    n2 = q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    # tan of a/4, a/8, a/16, each divided by n = sin(a/2)
    r = 1.0 / (1.0 + w)
    r = r / (1.0 + jnp.sqrt(1.0 + n2 * r * r))
    r = r / (1.0 + jnp.sqrt(1.0 + n2 * r * r))
    k = 16.0 * r * _series(n2 * r * r, _ATAN)
    rotation = scale(sign * k, (q[1], q[2], q[3]))
    b = _log_coefficient(k * k * n2)
    once = cross(rotation, translation)
    twice = cross(rotation, once)
    return add(translation, add(scale(-0.5, once), scale(b, twice))), rotation  # type: ignore[arg-type]


@jax.jit
def right_jacobian_series(rotation: Vec3) -> Quat:
    """The four power series in the right Jacobian: most of its arithmetic, shared by its 18 entries."""
    t2 = dot(rotation, rotation)
    return _series(t2, _B), _series(t2, _C2), _series(t2, _C3), _series(t2, _C4)


@jax.jit
def right_jacobian(translation: Vec3, rotation: Vec3, series: Quat | None = None) -> tuple[Mat3, Mat3]:
    """Blocks (J, Q) of the right Jacobian `[[J, Q], [0, J]]` in (translation, rotation) order, angle up to pi.

    `series`: `right_jacobian_series(rotation)`, where the caller has it.
    """
    v, w = translation, rotation
    t2 = dot(w, w)
    b, c2, c3, c4 = right_jacobian_series(rotation) if series is None else series
    d = dot(w, v)
    jacobian = _affine(1.0 - c2 * t2, -b, c2, w, w, w)
    # Q = -b [v] - (2 c3 - c2) d [w] + c2 (v w' + w v') - 2 c4 d w w' + (2 c4 d a^2 - 2 c2 d) I
    q_skew = add(scale(-b, v), scale((c2 - 2 * c3) * d, w))
    half = add(scale(c2, v), scale(-c4 * d, w))
    coupling = mat_add(
        _affine((2 * c4 * t2 - 2 * c2) * d, jnp.ones_like(d), jnp.ones_like(d), q_skew, half, w),
        tuple(tuple(wi * hj for hj in half) for wi in w),  # type: ignore[arg-type]
    )
    return jacobian, coupling


def inverse_right_jacobian_transposed(
    translation: Vec3, rotation: Vec3, on_translation: Vec3, on_rotation: Vec3
) -> tuple[Vec3, Vec3]:
    """`J_r^-T f`: forces on `Log` to forces on a pose multiplied on the right, angle below pi."""
    t2 = dot(rotation, rotation)
    b = _log_coefficient(t2)
    _, coupling = right_jacobian(translation, rotation)

    def inverse_transposed(f: Vec3) -> Vec3:
        # J^-T = I - [w]/2 + b [w]^2
        once = cross(rotation, f)
        return add(f, add(scale(-0.5, once), scale(b, cross(rotation, once))))  # type: ignore[arg-type]

    force = inverse_transposed(on_translation)
    rest = sub(on_rotation, matvec(transpose(coupling), force))
    return force, inverse_transposed(rest)


def _log_coefficient(t2: Array) -> Array:
    """`(1 - (a/2) cot(a/2)) / a^2` of the squared angle, angle below 2 pi."""
    small = t2 < SERIES_BELOW_RAD2
    t2_safe = jnp.where(small, 1.0, t2)
    quarter = 0.25 * t2_safe
    cot = _series(quarter, _COS) / _series(quarter, _SINC)  # (a/2) cot(a/2)
    return jnp.where(small, _series(t2, _LOG_B), (1.0 - cot) / t2_safe)


def _affine(diagonal: Array, skew: Array, outer: Array, a: Vec3, p: Vec3, q: Vec3) -> Mat3:
    """`diagonal I + skew [a]x + outer p q'`."""
    sa = scale(skew, a)
    m = tuple(tuple(outer * pi * qj for qj in q) for pi in p)
    return (
        (m[0][0] + diagonal, m[0][1] - sa[2], m[0][2] + sa[1]),
        (m[1][0] + sa[2], m[1][1] + diagonal, m[1][2] - sa[0]),
        (m[2][0] - sa[1], m[2][1] + sa[0], m[2][2] + diagonal),
    )
