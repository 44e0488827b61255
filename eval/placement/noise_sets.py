"""A few sets of noise that stand for an ensemble: layouts are searched under these, and judged under all."""

import jax.numpy as jnp
import numpy as np

from eval.placement.plan import Plan, position_at
from eval.placement.plan_drift import carried, own_covariance
from jaxgeo.graph.components import NoiseEnsemble


def few_sets(noise: NoiseEnsemble, plan: Plan, most: int) -> NoiseEnsemble:
    """Sets at evenly spaced quantiles of the drift that they foretell at the path's end, all of one weight."""
    if noise.weight.shape[0] <= most:
        return noise
    end = jnp.array([len(plan) - 1.0])
    own = own_covariance(carried(plan, noise, end, position_at(plan, end)), plan, noise)
    size = np.trace(np.asarray(own)[:, 0], axis1=1, axis2=2)
    order = np.argsort(size, kind="stable")
    share = np.cumsum(np.asarray(noise.weight)[order])
    rows = order[np.searchsorted(share, (np.arange(most) + 0.5) / most * share[-1])]
    return NoiseEnsemble(noise.sigma[rows], jnp.full(most, 1.0 / most), noise.correlation_m)
