"""Bootstrap intervals (Efron 1979, percentile): how far a figure would vary over other locations or sessions."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxgeo.errors import InputError

Statistic = Callable[[Array], Array]


def bootstrap_interval(
    values: Float[np.ndarray, "n ..."], statistic: Statistic, *, seed: int, draws: int = 2000, level: float = 0.95
) -> tuple[float, float]:
    """Ends of the middle `level` of the statistic over resampled rows, all draws in one compiled call.

    Args:
        values: (n, ...) one row for each unit that could have been another: a location, a session.
        statistic: from an array like `values` to a number; a function of a module, for another one compiles anew.

    Returns:
        (low, high); NaN for a single row, which says nothing of how rows differ.

    Raises:
        InputError: no rows, or a value that is not finite: leave out what failed, and say so.
    """
    values = np.asarray(values, dtype=np.float64)
    if len(values) == 0 or not np.isfinite(values).all():
        bad = int((~np.isfinite(values)).sum())
        raise InputError(
            f"bootstrap of an array of shape {values.shape} with {bad} value(s) that are not finite: expected at least "
            "one row, all finite. Leave out the rows that failed."
        )
    if len(values) == 1:
        return (float("nan"), float("nan"))
    found = _resampled(jnp.asarray(values), jax.random.key(seed), statistic, draws)
    low, high = np.quantile(np.asarray(found), [0.5 - level / 2.0, 0.5 + level / 2.0])
    return float(low), float(high)


def resampled_rows(n: int, *, seed: int, draws: int = 2000) -> Int[np.ndarray, "draws n"]:
    """The rows that each draw of `bootstrap_interval` takes."""
    return np.asarray(_rows(jax.random.key(seed), n, draws))


@functools.partial(jax.jit, static_argnames=("statistic", "draws"))
def _resampled(values: Array, key: Array, statistic: Statistic, draws: int) -> Float[Array, "draws"]:
    return jax.vmap(lambda row: statistic(values[row]))(_rows(key, values.shape[0], draws))


def _rows(key: Array, n: int, draws: int) -> Int[Array, "draws n"]:
    return jax.random.randint(key, (draws, n), 0, n)


def mean(values: Array) -> Array:
    """Of everything in the array."""
    return jnp.mean(values)


def rms(values: Array) -> Array:
    """Root mean square of everything in the array."""
    return jnp.sqrt(jnp.mean(values**2))


def geometric_mean(values: Array) -> Array:
    """Of positive numbers, such as ratios."""
    return jnp.exp(jnp.mean(jnp.log(values)))


def ratio_of_means(values: Float[Array, "n 2"]) -> Array:
    """Mean of the first column over mean of the second: pairs stay together."""
    return jnp.mean(values[:, 0]) / jnp.mean(values[:, 1])
