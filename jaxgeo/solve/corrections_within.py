"""What the sightings of single visits say of the corrections: a marker that stands still must be seen standing still.

A visit's composed positions p_i (n sightings, map frame) move with the corrections g by J_i g. With the marker's own
position m of each visit unknown,

    p_i + J_i (g - g0) = m + e_i,       Cov(e_i, e_j) = (w^2 [i = j] + s^2 rho_ij + f^2) L_i L_j'
                                                        + (q^2 min(t_i, t_j) + r^2 t_i t_j) I

the sightings' own covariance L_i L_i', L_i turning with the body: what is drawn anew, what a changing view changes only
slowly, rho = exp(-|t_i - t_j| / `VIEW_S`), and what a whole visit shares; and the odometry's drift since the visit
began, random and steady. The five factors are learned from all visits together by restricted likelihood, m and g
integrated out, so that the noise does not swallow the corrections, nor they the noise. A rig whose clock is wrong
smears every marker along its velocity; only what of the smear is the same all through a visit is left to the comparison
between visits.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from jaxgeo.associate.centroid import CentroidRule
from jaxgeo.data import Sightings, Trajectory, Visit
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.solve.corrections import N_CORRECTIONS, compose

# A visit's sightings are thinned evenly to so many: the cost grows with the cube.
MOST_SIGHTINGS = 40
VIEW_S = 2.0
# Prior of the logarithms of w, s, f, q (m per root second) and r (m/s): medians and standard deviations. A visit's
# common error shows only where the body turns, so it leans on what `CentroidRule` assumes of it.
_MEDIAN = np.log([1.0, 0.5, CentroidRule.common_fraction, 0.02, 0.01])
_LOG_SD = np.array([1.5, 1.5, 0.7, 1.5, 1.5])
# Sightings further off than this, in standard deviations of their own, lose weight (Huber); visits that scatter more
# or less than the others get a factor of their own, worth this many sightings' coordinates of prior.
_HUBER = 3.5
_VISIT_DEGREES = 10.0
_REWEIGHTINGS = 3


class Within(eqx.Module):
    """Visits' sightings at some corrections g0, padded to `MOST_SIGHTINGS`.

    Attributes:
        real: (v, n) 1 for a sighting, 0 for padding.
        time_s: (v, n) since the visit's first.
        position_m: (v, n, 3) about the visit's mean; `jacobian` (v, n, 3, 7).
        factor_m: (v, n, 3, 3) square roots L of the sightings' covariances: map axes by body axes.
    """

    real: Float[Array, "v n"]
    time_s: Float[Array, "v n"]
    position_m: Float[Array, "v n 3"]
    jacobian: Float[Array, "v n 3 7"]
    factor_m: Float[Array, "v n 3 3"]


class WithinInformation(eqx.Module):
    """The visits' log-likelihood of the step d = g - g0: pull'd - d' information d / 2, its noise learned.

    Attributes:
        information: (7, 7); `pull` (7,).
        log_sigma: (5,) of the five factors.
        weights: of sightings and visits, as the last search for the factors had them.
        value: negative log of the restricted posterior of the factors, d integrated out; what offsets are compared by.
    """

    information: Float[np.ndarray, "7 7"]
    pull: Float[np.ndarray, "7"]
    log_sigma: Float[np.ndarray, "5"]
    weights: "Weights"
    value: float


def within_visits(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    value: Float[np.ndarray, "7"],
    difference_s: float,
) -> Within:
    """The visits composed at the corrections `value`, as many rows as a bucket holds; padding is one row of zeros.

    Raises:
        SightingError: as `compose`.
    """
    n, v = MOST_SIGHTINGS, anchor_bucket(len(visits))
    rows = [v.sightings[np.unique(np.linspace(0, v.count - 1, min(v.count, n)).round().astype(int))] for v in visits]
    found = compose(trajectory, sightings, rows, value, difference_s)
    scale, axes = np.linalg.eigh(found.covariance_m2)
    factor_m = (axes * np.sqrt(np.maximum(scale, 0.0))[:, None]) @ np.swapaxes(axes, 1, 2) @ found.R_map_body
    real = np.zeros((v, n))
    place = [(visit, i) for visit, some in enumerate(rows) for i in range(len(some))]
    at = tuple(np.array(place).T)
    real[at] = 1.0

    def spread(of: np.ndarray, fill: float | np.ndarray = 0.0) -> np.ndarray:
        out = np.broadcast_to(fill, (v, n, *of.shape[1:])).copy()
        out[at] = of
        return out

    first_s = np.array([found.stamp_s[row] for row in np.cumsum([0] + [len(some) for some in rows[:-1]])])
    position_m = spread(found.position_m)
    position_m -= real[..., None] * (position_m.sum(axis=1) / np.maximum(real.sum(axis=1), 1.0)[:, None])[:, None]
    return Within(
        jnp.asarray(real),
        jnp.asarray(spread(found.stamp_s - first_s[at[0]])),
        jnp.asarray(position_m),
        jnp.asarray(spread(found.jacobian)),
        jnp.asarray(spread(factor_m, np.eye(3))),
    )


class Weights(eqx.Module):
    """(v, n) of the sightings and (v,) of the visits, both 1 at first; 0 leaves a visit out."""

    sighting: Float[Array, "v n"]
    visit: Float[Array, "v"]


def first_weights(data: Within) -> Weights:
    """All 1; a visit of one sighting is left out, for it cannot disagree with itself."""
    return Weights(jnp.ones_like(data.real), (data.real.sum(axis=1) > 1.0).astype(float))


class Reduced(eqx.Module):
    """Per visit, its marker's position eliminated: J'PJ, J'Pp, p'Pp and log-determinants."""

    information: Float[Array, "v 7 7"]
    pull: Float[Array, "v 7"]
    square: Float[Array, "v"]
    log_det: Float[Array, "v"]


def _covariance(log_sigma: Array, data: Within, weights: Weights) -> Float[Array, "v a a"]:
    """(v, 3n, 3n) of the visits' sightings; padding is the identity."""
    w, s, f, q, r = jnp.exp(log_sigma)
    v, n = data.real.shape
    own = jnp.eye(n)[None] / jnp.maximum(weights.sighting, 1e-3)[:, None]
    lag = jnp.abs(data.time_s[:, :, None] - data.time_s[:, None, :])
    like = w**2 * own + s**2 * jnp.exp(-lag / VIEW_S) + f**2
    both = data.real[:, :, None] * data.real[:, None, :]
    sighted = jnp.einsum("vij,viab,vjcb->viajc", like * both, data.factor_m, data.factor_m)
    first, second = data.time_s[:, :, None], data.time_s[:, None, :]
    drift = both * (q**2 * jnp.minimum(first, second) + r**2 * first * second)
    total = sighted + jnp.einsum("vij,ac->viajc", drift, jnp.eye(3))
    padding = jnp.einsum("vi,ij,ac->viajc", 1.0 - data.real, jnp.eye(n), jnp.eye(3))
    factor = jnp.where(weights.visit > 0, 1.0 / jnp.where(weights.visit > 0, weights.visit, 1.0), 1.0)
    return (factor[:, None, None, None, None] * total + padding).reshape(v, 3 * n, 3 * n)


def reduced(log_sigma: Array, data: Within, weights: Weights) -> Reduced:
    """With P = K^-1 - K^-1 A (A' K^-1 A)^-1 A' K^-1 of each visit, K its covariance, A its marker's position."""
    v, n = data.real.shape
    mean = jnp.einsum("vi,ac->viac", data.real, jnp.eye(3)).reshape(v, 3 * n, 3)
    rhs = jnp.concatenate(
        [mean, data.jacobian.reshape(v, 3 * n, N_CORRECTIONS), data.position_m.reshape(v, 3 * n, 1)], axis=-1
    )
    factor = jnp.linalg.cholesky(_covariance(log_sigma, data, weights))
    white = jax.scipy.linalg.solve_triangular(factor, rhs, lower=True)
    normal = jnp.swapaxes(white, 1, 2) @ white
    unused = jnp.where(data.real.sum(axis=1) > 0, 0.0, 1.0)
    mean_factor = jnp.linalg.cholesky(normal[:, :3, :3] + unused[:, None, None] * jnp.eye(3)[None])
    along = jax.scipy.linalg.solve_triangular(mean_factor, normal[:, :3, 3:], lower=True)
    rest = normal[:, 3:, 3:] - jnp.swapaxes(along, 1, 2) @ along
    log_det = jnp.log(jnp.diagonal(factor, axis1=1, axis2=2)).sum(-1)
    log_det = log_det + jnp.log(jnp.diagonal(mean_factor, axis1=1, axis2=2)).sum(-1)
    used = (weights.visit > 0).astype(float)
    return Reduced(
        rest[:, :-1, :-1] * used[:, None, None],
        rest[:, :-1, -1] * used[:, None],
        rest[:, -1, -1] * used,
        log_det * used,
    )


def _negative_log_posterior(
    log_sigma: Array, data: Within, weights: Weights, centre: Array, prior_sigma: Array
) -> Float[Array, ""]:
    """Of the factors; the step d has the prior N(centre, diag(prior_sigma^2)) and is integrated out."""
    each = reduced(log_sigma, data, weights)
    information, pull = each.information.sum(0), -each.pull.sum(0)
    # The square about the prior's centre, then the gain of moving from there.
    square = each.square.sum() - 2.0 * pull @ centre + centre @ information @ centre
    pull = prior_sigma * (pull - information @ centre)
    curvature = jnp.eye(N_CORRECTIONS) + prior_sigma[:, None] * information * prior_sigma[None]
    factor = jnp.linalg.cholesky(curvature)
    gain = jax.scipy.linalg.solve_triangular(factor, pull, lower=True)
    off = (log_sigma - jnp.asarray(_MEDIAN)) / jnp.asarray(_LOG_SD)
    log_det = each.log_det.sum() + jnp.log(jnp.diagonal(factor)).sum()
    return 0.5 * (square - gain @ gain + off @ off) + log_det


_value_and_gradient = jax.jit(jax.value_and_grad(_negative_log_posterior))


@jax.jit
def _reweighted(
    log_sigma: Array, data: Within, weights: Weights, centre: Array, prior_sigma: Array
) -> tuple[Weights, Array, Array]:
    """Weights from the residuals at the best step, and information and pull about g0 with the weights given."""
    each = reduced(log_sigma, data, weights)
    information, pull = each.information.sum(0), -each.pull.sum(0)
    covariance, step = _posterior(information, pull, centre, prior_sigma)
    square = each.square + 2.0 * each.pull @ step + jnp.einsum("a,vab,b->v", step, each.information, step)
    degrees = 3.0 * jnp.maximum(data.real.sum(1) - 1.0, 0.0)
    scale = jnp.where(weights.visit > 0, weights.visit, 1.0)
    visit = (_VISIT_DEGREES + degrees) / (_VISIT_DEGREES + square / scale)
    left = data.position_m + data.jacobian @ step
    v, n = data.real.shape
    plain = _covariance(log_sigma, data, Weights(jnp.ones_like(weights.sighting), weights.visit))
    own = plain.reshape(v, n, 3, n, 3)[:, jnp.arange(n), :, jnp.arange(n), :]  # (n, v, 3, 3)
    middle = (left * (weights.sighting * data.real)[..., None]).sum(1) / jnp.maximum(
        (weights.sighting * data.real).sum(1), 1e-9
    )[:, None]
    off = left - middle[:, None]
    distance = jnp.sqrt(
        jnp.einsum("via,via->vi", off, jnp.linalg.solve(jnp.swapaxes(own, 0, 1), off[..., None])[..., 0])
    )
    sighting = (_HUBER / jnp.maximum(distance, _HUBER)) ** 2
    # What the visits' own pulls scatter by, against what the model says (Huber's sandwich): never surer than either.
    apart = (-each.pull - each.information @ step) @ covariance
    claimed = jnp.diagonal(covariance @ information @ covariance)
    looser = jnp.max((apart**2).sum(axis=0) / jnp.where(claimed > 0, claimed, jnp.inf))
    looser = jnp.maximum(looser, 1.0)
    return Weights(sighting, jnp.where(weights.visit > 0, visit, 0.0)), information / looser, pull / looser


def _posterior(information: Array, pull: Array, centre: Array, prior_sigma: Array) -> tuple[Array, Array]:
    """Covariance and mean of the step; a prior width of zero holds it at the centre."""
    curvature = jnp.eye(N_CORRECTIONS) + prior_sigma[:, None] * information * prior_sigma[None]
    covariance = prior_sigma[:, None] * jnp.linalg.inv(curvature) * prior_sigma[None]
    return covariance, centre + covariance @ (pull - information @ centre)


def within_information(
    data: Within,
    centre: Float[np.ndarray, "7"],
    prior_sigma: Float[np.ndarray, "7"],
    start: Float[np.ndarray, "5"] | None = None,
) -> WithinInformation:
    """Learn the factors from visits of two sightings or more; the step's prior has its middle at `centre`, off g0."""
    weights = first_weights(data)
    log_sigma = _MEDIAN if start is None else start
    prior = jnp.asarray(centre), jnp.asarray(prior_sigma)
    for turn in range(_REWEIGHTINGS):
        found = minimize(
            lambda x, w=weights: tuple(np.asarray(y) for y in _value_and_gradient(jnp.asarray(x), data, w, *prior)),
            log_sigma,
            jac=True,
            method="L-BFGS-B",
            bounds=[(m - 4.0 * sd, m + 4.0 * sd) for m, sd in zip(_MEDIAN, _LOG_SD, strict=True)],
            options={"ftol": 1e-8, "maxiter": 40},
        )
        log_sigma = found.x
        new, information, pull = _reweighted(jnp.asarray(log_sigma), data, weights, *prior)
        if turn + 1 < _REWEIGHTINGS:
            weights = new
    return WithinInformation(np.asarray(information), np.asarray(pull), log_sigma, weights, float(found.fun))


@jax.jit
def scan_value(log_sigma: Array, data: Within, centre: Array, prior_sigma: Array) -> Float[Array, ""]:
    """How badly the visits fit at g0 under known factors, every visit's level its own: for a scan over the offsets.

    The time offset stands still where `prior_sigma` is zero for it. A negative log of Student's density per visit.
    """
    weights = first_weights(data)
    each = reduced(log_sigma, data, weights)
    _, step = _posterior(each.information.sum(0), -each.pull.sum(0), centre, prior_sigma)
    square = each.square + 2.0 * each.pull @ step + jnp.einsum("a,vab,b->v", step, each.information, step)
    degrees = 3.0 * jnp.maximum(data.real.sum(1) - 1.0, 0.0)
    fit = 0.5 * (_VISIT_DEGREES + degrees) * jnp.log1p(jnp.maximum(square, 0.0) / _VISIT_DEGREES)
    return jnp.sum(jnp.where(weights.visit > 0, fit + each.log_det, 0.0))
