"""Restricted maximum likelihood of variance components (Patterson and Thompson 1971), on contrasts.

The anchors' misclosures c ~ N(X b, R + sum_c sigma_c^2 V_c); the columns of X are what is not to be learned from: the
six of the gauge, and the coordinates of every location that is only revisited. Contrasts, combinations of the rows that
X does not reach, are free of b, and their likelihood is the restricted one:

    -log L = 1/2 log det M + 1/2 c' M^-1 c,      M = R + sum_c exp(2 theta_c) V_c

with a normal prior on theta = log sigma. All matrices have the anchors' size. The average information (Gilmour,
Thompson and Cullis 1995), half observed and half expected, costs no product of matrices per component.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.observations import Learnable
from jaxgeo.solve.ensemble import AnchorSystem

# Combinations of rows are contrasts where X X', its columns of unit length, has an eigenvalue below this.
_CONTRAST_BELOW = 1e-9
# A location is foretold from the others where its contrasts keep this share of it, at least: below, the others hardly
# fix the frame, and what they foretell is rounding.
_FORETOLD_ABOVE = 1e-3


class Contrasts(eqx.Module):
    """Misclosures free of gauge and unknown coordinates; what is no contrast is a row of the identity, with c = 0.

    Attributes:
        c, base, components: of the contrasts.
        basis: (m, m) rows to contrasts, zero columns where there is none; `count` how many there are.
        location_rows: (k, m) 1 for the rows of a location with known coordinates, at its first visit; others zero, and
            those of a location without which the frame is not fixed.
    """

    c: Float[Array, "m"]
    base: Float[Array, "m m"]
    components: Float[Array, "n m m"]
    basis: Float[Array, "m m"]
    count: Float[Array, ""]
    location_rows: Float[Array, "k m"]


class Prior(eqx.Module):
    """Normal prior of theta = log sigma, of the components that are `free`; the others are zero noise."""

    mean: Float[Array, "n"]
    precision: Float[Array, "n n"]
    free: Float[Array, "n"]


def contrasts(system: AnchorSystem, learnable: Learnable) -> Contrasts:
    """Project gauge and unknown coordinates out."""
    k, d, _ = system.jacobian.shape
    # One block of columns per location: that of its first visit.
    together = learnable.unknown[:, None] * learnable.unknown[None] * learnable.same_location
    first = _first(together) * learnable.unknown
    # A marker's own position and, where it was seen, rotation: blocks of the pose's, without what couples them.
    own = system.jacobian.at[:, :3, 3:].set(0.0)
    location = jnp.einsum("kda,kl->kdla", own, together * first[None]).reshape(k * d, 6 * k)
    learn = jnp.repeat(learnable.learn, d)
    # The frame moves a marker of unknown position as that position does. At the visits' own points, which drift keeps
    # apart, it would take what is to be learned from for a turned frame.
    frame = system.jacobian * (1.0 - learnable.unknown)[:, None, None]
    x = jnp.concatenate([frame.reshape(k * d, 6), location], axis=1) * learn[:, None]
    norm = jnp.sqrt((x * x).sum(axis=0))
    x = x / jnp.where(norm > 0, norm, 1.0)[None]
    value, vector = jnp.linalg.eigh(x @ x.T + jnp.diag(1.0 - learn))
    keep = (value < _CONTRAST_BELOW).astype(float)
    basis = vector * keep[None]

    def turn(matrix: Array) -> Array:
        return basis.T @ matrix @ basis

    known = learnable.learn * (1.0 - learnable.unknown)
    of_location = known[:, None] * known[None] * learnable.same_location
    rows = jnp.repeat(of_location * _first(of_location)[:, None], d, axis=1)
    rows = rows * jax.lax.map(lambda own: _foretold(own, basis @ basis.T), rows)[:, None]
    return Contrasts(
        basis.T @ (system.residual * learn),
        turn(system.base) + jnp.diag(1.0 - keep),
        jax.vmap(turn)(system.components),
        basis,
        keep.sum(),
        rows,
    )


def _foretold(rows: Float[Array, "m"], projector: Float[Array, "m m"]) -> Float[Array, ""]:
    """1 where the other locations fix the frame without these rows: by geometry alone, the same for every noise."""
    pivot = jnp.diagonal(jnp.linalg.cholesky(projector * rows[:, None] * rows[None] + jnp.diag(1.0 - rows)))
    return jnp.where(jnp.min(pivot) ** 2 > _FORETOLD_ABOVE, 1.0, 0.0)  # NaN: no


def _first(together: Float[Array, "k k"]) -> Float[Array, "k"]:
    """1 for the first visit of every group."""
    return jnp.where(jnp.tril(together, -1).sum(axis=1) > 0, 0.0, 1.0)


def negative_log_posterior(theta: Float[Array, "n"], args: tuple[Contrasts, Prior]) -> Float[Array, ""]:
    """Restricted negative log-likelihood plus the prior's half square."""
    found, prior = args
    factor = _factor(theta, found, prior)
    y = jax.scipy.linalg.solve_triangular(factor, found.c, lower=True)
    off = prior.free * (theta - prior.mean)
    return 0.5 * y @ y + jnp.sum(jnp.log(jnp.diagonal(factor))) + 0.5 * off @ prior.precision @ off


def _variances(theta: Array, prior: Prior) -> Array:
    return prior.free * jnp.exp(2.0 * jnp.where(prior.free > 0, theta, 0.0))


def _factor(theta: Array, found: Contrasts, prior: Prior) -> Array:
    return jnp.linalg.cholesky(found.base + jnp.einsum("c,cxy->xy", _variances(theta, prior), found.components))


class Derivatives(eqx.Module):
    """Value, gradient and average information of `negative_log_posterior`."""

    value: Float[Array, ""]
    gradient: Float[Array, "n"]
    information: Float[Array, "n n"]


def derivatives(theta: Float[Array, "n"], args: tuple[Contrasts, Prior]) -> Derivatives:
    """In closed form; frozen components have zero gradient and unit information."""
    found, prior = args
    variance = _variances(theta, prior)
    factor = _factor(theta, found, prior)
    inverse = _inverse(factor)
    y = inverse @ found.c
    pulled = found.components @ y
    trace = jnp.einsum("cxy,xy->c", found.components, inverse)
    off = prior.free * (theta - prior.mean)
    value = 0.5 * found.c @ y + jnp.sum(jnp.log(jnp.diagonal(factor))) + 0.5 * off @ prior.precision @ off
    gradient = variance * (trace - pulled @ y) + prior.free * (prior.precision @ off)
    average = 2.0 * variance[:, None] * variance[None] * (pulled @ inverse @ pulled.T)
    return Derivatives(value, gradient, average + _masked(prior))


def _inverse(factor: Array) -> Array:
    return jax.scipy.linalg.cho_solve((factor, True), jnp.eye(factor.shape[0]))


def _masked(prior: Prior) -> Array:
    """The prior's precision, and a unit one for what is frozen."""
    return prior.precision * prior.free[:, None] * prior.free[None] + jnp.diag(1.0 - prior.free)


def hessian(theta: Float[Array, "n"], args: tuple[Contrasts, Prior]) -> Float[Array, "n n"]:
    """The exact second derivatives, unit ones for what is frozen."""
    found, prior = args
    variance = _variances(theta, prior)
    inverse = _inverse(_factor(theta, found, prior))
    y = inverse @ found.c
    pulled = found.components @ y
    times = found.components @ inverse
    n = variance.shape[0]
    trace = jnp.trace(times, axis1=1, axis2=2)
    traces = times.reshape(n, -1) @ jnp.swapaxes(times, 1, 2).reshape(n, -1).T
    both = variance[:, None] * variance[None]
    likelihood = both * (4.0 * (pulled @ inverse @ pulled.T) - 2.0 * traces)
    likelihood = likelihood + jnp.diag(2.0 * variance * (trace - pulled @ y))
    return likelihood + _masked(prior)


def log_predictive(theta: Float[Array, "n"], args: tuple[Contrasts, Prior]) -> Float[Array, ""]:
    """Log density of every known location's misclosures as all the others predict them, summed over the locations.

    In closed form from P = A (A'MA)^-1 A', A the contrasts: the residuals are P_ll^-1 (P c)_l of covariance P_ll^-1
    (Dubrule 1983). The noise is the one given, not learned anew without the location. A location without which the
    frame is not fixed has none.
    """
    found, prior = args
    factor = _factor(theta, found, prior)
    half = jax.scipy.linalg.solve_triangular(factor, jnp.column_stack([found.basis.T, found.c]), lower=True)
    p = half[:, :-1].T @ half[:, :-1]
    pc = half[:, :-1].T @ half[:, -1]

    def one(rows: Float[Array, "m"]) -> Float[Array, ""]:
        block = jnp.linalg.cholesky(p * rows[:, None] * rows[None] + jnp.diag(1.0 - rows))
        y = jax.scipy.linalg.solve_triangular(block, pc * rows, lower=True)
        density = jnp.sum(jnp.log(jnp.diagonal(block))) - 0.5 * y @ y
        return jnp.where((rows.sum() > 0) & jnp.isfinite(density), density, 0.0)

    return jax.lax.map(one, found.location_rows).sum()
