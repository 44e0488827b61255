"""Robust losses on squared, whitened residuals.

`rho(s) ~ s` for small s, so that `rho / 2` stands where `s / 2` stood. Beyond `width` (in standard deviations)
an observation counts less: `huber` grows linearly with |r|, `cauchy` as its logarithm, `geman_mcclure` stays below
width^2.
"""

from typing import Literal, assert_never, get_args

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.errors import ConfigError

RobustKind = Literal["none", "huber", "cauchy", "geman_mcclure"]


def check_robust(kind: str, width: float) -> None:
    """Refuse an unknown loss or a width that is not positive.

    Raises:
        ConfigError: naming the value and the choices.
    """
    if kind not in get_args(RobustKind):
        raise ConfigError(f"robust loss {kind!r} is unknown; expected one of {', '.join(get_args(RobustKind))}.")
    if not width > 0.0:
        raise ConfigError(f"robust width {width} is not positive; expected standard deviations, for example 3.0.")


def robust_rho(
    squared_norm: Float[Array, "*b"], kind: RobustKind, width: Float[Array, ""] | float
) -> Float[Array, "*b"]:
    """The loss that takes the place of the squared norm."""
    return squared_norm * _rho_over_s(squared_norm, kind, width)


def robust_weight(
    squared_norm: Float[Array, "*b"], kind: RobustKind, width: Float[Array, ""] | float
) -> Float[Array, "*b"]:
    """`d rho / d s`: 1 at zero, falling towards 0; the weight of iteratively reweighted least squares."""
    u = squared_norm / width**2
    match kind:
        case "none":
            return jnp.ones_like(u)
        case "huber":
            return 1.0 / jnp.sqrt(jnp.maximum(u, 1.0))
        case "cauchy":
            return 1.0 / (1.0 + u)
        case "geman_mcclure":
            return 1.0 / (1.0 + u) ** 2
        case _:
            assert_never(kind)


def robust_residual(
    residual: Float[Array, "*b d"], kind: RobustKind, width: Float[Array, ""] | float
) -> Float[Array, "*b d"]:
    """Whitened residuals shortened so that their squared norm is rho: any least-squares solver then minimises rho."""
    squared_norm = jnp.sum(residual * residual, axis=-1)
    return residual * jnp.sqrt(_rho_over_s(squared_norm, kind, width))[..., None]


def _rho_over_s(
    squared_norm: Float[Array, "*b"], kind: RobustKind, width: Float[Array, ""] | float
) -> Float[Array, "*b"]:
    """rho(s) / s, in (0, 1], regular at s = 0."""
    u = squared_norm / width**2
    match kind:
        case "none":
            return jnp.ones_like(u)
        case "huber":
            root = jnp.sqrt(jnp.maximum(u, 1.0))
            return (2.0 * root - 1.0) / root**2
        case "cauchy":
            small = u < 1e-3
            v = jnp.where(small, u, 0.0)
            series = 1.0 - v / 2.0 + v**2 / 3.0 - v**3 / 4.0 + v**4 / 5.0
            safe = jnp.where(small, 1.0, u)
            return jnp.where(small, series, jnp.log1p(safe) / safe)
        case "geman_mcclure":
            return 1.0 / (1.0 + u)
        case _:
            assert_never(kind)
