"""One number for the accuracy along a path: what a placement makes small."""

from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Criterion = Literal["path", "worst", "D", "E"]
CRITERIA: tuple[Criterion, ...] = ("path", "worst", "D", "E")
Robust = Literal["mixture", "mean", "worst"]
# The power of the mean that stands for the largest of m values: smooth, and at most m^(1/64) below it (7 % for 128).
_POWER = 64.0


def criterion_m(covariance_m2: Float[Array, "m 3 3"], kind: Criterion, *, smooth: bool = False) -> Float[Array, ""]:
    """A length in metres.

    `path`: root of the mean over the path of the position variance, all axes together (A-optimality). `worst`: the
    same of the least accurate point. `D`: geometric mean of all axes of all error ellipsoids. `E`: the longest axis of
    any ellipsoid. `smooth`: a power mean in place of the largest, to be searched by gradient.
    """
    largest = _power_mean if smooth else jnp.max
    if kind == "path":
        return jnp.sqrt(jnp.mean(jnp.trace(covariance_m2, axis1=1, axis2=2)))
    if kind == "worst":
        return largest(jnp.sqrt(jnp.trace(covariance_m2, axis1=1, axis2=2)))
    if kind == "D":
        return jnp.exp(jnp.mean(jnp.linalg.slogdet(covariance_m2)[1]) / 6.0)
    return largest(jnp.sqrt(jnp.linalg.eigvalsh(covariance_m2)[:, -1]))


def robust_criterion_m(
    covariance_m2: Float[Array, "q m 3 3"],
    weight: Float[Array, "q"],
    kind: Criterion,
    robust: Robust,
    *,
    smooth: bool = False,
) -> Float[Array, ""]:
    """A criterion when the noise is itself uncertain.

    `mixture`: of the covariance that is the mean over the noise sets, what the estimator will claim on average.
    `mean`: the criterion's own mean. `worst`: of the set that makes it largest.
    """
    if robust == "mixture":
        return criterion_m(jnp.einsum("q,qmab->mab", weight, covariance_m2), kind, smooth=smooth)
    each = jax.vmap(lambda c: criterion_m(c, kind, smooth=smooth))(covariance_m2)
    if robust == "mean":
        return jnp.sum(weight * each)
    return (_power_mean if smooth else jnp.max)(jnp.where(weight > 0.0, each, 0.0))


def _power_mean(value: Float[Array, "m"]) -> Float[Array, ""]:
    top = jax.lax.stop_gradient(jnp.max(value))
    return top * jnp.mean((value / top) ** _POWER) ** (1.0 / _POWER)
