"""Small likelihoods whose posterior can be integrated on a grid."""

import jax.numpy as jnp
import numpy as np

from calibration.reml import Contrasts, Prior
from jaxgeo.graph.components import N_COMPONENTS


def toy(m: int, sigma: dict[int, float], seed: int = 0) -> Contrasts:
    """`m` numbers of noise 1 and of components with random covariances, of four locations."""
    rng = np.random.default_rng(seed)
    components = np.zeros((N_COMPONENTS, m, m))
    for c in range(N_COMPONENTS):
        root = rng.standard_normal((m, m)) * (rng.uniform(size=m) < 0.6)[:, None]
        components[c] = root @ root.T / m
    covariance = np.eye(m) + sum(s**2 * components[c] for c, s in sigma.items())
    c = np.linalg.cholesky(covariance) @ rng.standard_normal(m)
    eye, of_location = jnp.eye(m), np.repeat(np.eye(4), m // 4, axis=1)
    return Contrasts(
        c=jnp.asarray(c),
        base=eye,
        components=jnp.asarray(components),
        basis=eye,
        count=jnp.asarray(float(m)),
        location_rows=jnp.asarray(of_location),
    )


def toy_prior(free: tuple[int, ...], median: float = 1.0, sd: float = 1.0, tied: float = 0.0) -> Prior:
    """Log sigma of standard deviation `sd`, and correlated by `tied`."""
    on = np.isin(np.arange(N_COMPONENTS), free)
    covariance = sd**2 * ((1.0 - tied) * np.eye(N_COMPONENTS) + tied)
    precision = np.zeros((N_COMPONENTS, N_COMPONENTS))
    precision[np.ix_(on, on)] = np.linalg.inv(covariance[np.ix_(on, on)])
    mean = np.full(N_COMPONENTS, np.log(median))
    return Prior(jnp.asarray(mean), jnp.asarray(precision), jnp.asarray(on.astype(float)))
