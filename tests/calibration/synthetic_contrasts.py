"""Contrasts made by hand: no anchors, locations or basis behind them."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from calibration.reml import Contrasts


def contrasts_of(c: np.ndarray, base: np.ndarray, components: np.ndarray, count: int) -> Contrasts:
    """`count` contrasts, rows beyond them padding; what else a `Contrasts` holds says nothing."""
    m = len(c)
    values = {"c": c, "base": base, "components": components, "count": float(count)}
    values |= {"basis": np.eye(m), "location_rows": np.zeros((1, m))}
    names = [field.name for field in dataclasses.fields(Contrasts)]
    return Contrasts(**{name: jnp.asarray(values[name]) for name in names})
