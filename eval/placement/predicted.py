"""The accuracy that a layout of markers will give along a planned path, before anything is measured.

With C the prior covariance of points of the path with the visits, M the visits' own, H_0 their Jacobian in the gauge,
and G = (H_0' M^-1 H_0)^-1, the posterior covariance of the points is that of universal kriging,

    P = S - C M^-1 C' + X G X',      X = J - C M^-1 H_0

which no measurement enters. Rows of a visit are weighed by how well it is seen; of one that does not happen they are
rows of the identity.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from eval.placement.plan import Plan, position_at
from eval.placement.plan_drift import Places, carried, covariance_of, own_covariance
from eval.placement.plan_visits import Sight, Visits
from jaxgeo.graph.components import ANCHOR, NoiseEnsemble
from jaxgeo.solve.linearise import solve_gauge

# Information on the gauge, in 1/m^2 and 1/rad^2, where no visit gives any: it keeps the numbers finite.
FREE_INFORMATION = 1e-12
# Above this accuracy a layout does not fix the frame, or not usefully.
UNDETERMINED_M = 1e4


class Watched(eqx.Module):
    """Points of the path whose accuracy counts, and their prior covariance."""

    points: Places
    own_m2: Float[Array, "q m 3 3"]


def watched(
    plan: Plan,
    noise: NoiseEnsemble,
    count: int = 128,
    *,
    upto: float | None = None,
    beside_m: float | Float[Array, ""] = 0.0,
) -> Watched:
    """Points of the path evenly spaced along it, up to a place or its end.

    `beside_m`: in place of the path's own points, ones so far above, east and north of it, in turn: these feel a turn
    about a path that is straight.
    """
    last = float(len(plan) - 1) if upto is None else upto
    end_m = jnp.interp(jnp.asarray(last), jnp.arange(len(plan)).astype(float), plan.distance_m)
    along = jnp.linspace(0.0, 1.0, count) * end_m
    place = jnp.interp(along, plan.distance_m, jnp.arange(len(plan)).astype(float))
    offset = beside_m * jnp.roll(jnp.eye(3), 1, axis=0)[jnp.arange(count) % 3]
    points = carried(plan, noise, place, position_at(plan, place) + offset)
    return Watched(points, own_covariance(points, plan, noise))


def covariance_given(
    visits: Visits, plan: Plan, noise: NoiseEnsemble, watch: Watched, sight: Sight
) -> Float[Array, "q m 3 3"]:
    """Posterior covariance of the watched points given some visits, under every set of the noise.

    Where the visits do not fix the frame it is huge, not infinite.
    """
    places = carried(plan, noise, visits.place, visits.point_m)
    prior = covariance_of(places, places, plan, noise)
    cross = covariance_of(watch.points, places, plan, noise)
    return posterior_of(visits, places.jacobian, prior, cross, noise, watch, sight)


def posterior_of(
    visits: Visits,
    jacobian: Float[Array, "v 3 6"],
    prior: Float[Array, "q x x"],
    cross: Float[Array, "q y x"],
    noise: NoiseEnsemble,
    watch: Watched,
    sight: Sight,
) -> Float[Array, "q m 3 3"]:
    """The same once the prior covariances of the visits' markers, and theirs with the watched points, are known."""
    seen = jnp.repeat(visits.seen, 3)
    rows = seen.shape[0]
    together = (visits.location[:, None] == visits.location[None, :]).astype(float)
    survey = jnp.einsum("ij,ab->iajb", together, jnp.diag(sight.survey_sigma_m**2)).reshape(rows, rows)
    both = seen[:, None] * seen[None, :]
    measured = both * survey + sight.sigma_m**2 * jnp.eye(rows)
    gauge = jacobian.reshape(-1, 6) * seen[:, None]

    def one(sigma: Array, prior: Array, cross: Array, own: Array) -> Float[Array, "m 3 3"]:
        factor = jnp.linalg.cholesky(both * prior + (1.0 + sigma[ANCHOR] ** 2) * measured)
        right = jnp.concatenate([gauge, (cross * seen[None]).T], axis=1)
        whitened = jax.scipy.linalg.solve_triangular(factor, right, lower=True)
        wg, wc = whitened[:, :6], whitened[:, 6:].T.reshape(-1, 3, rows)
        free = solve_gauge(wg.T @ wg + FREE_INFORMATION * jnp.eye(6), jnp.eye(6))
        lever = watch.points.jacobian - wc @ wg
        found = own - wc @ jnp.swapaxes(wc, -1, -2) + lever @ free @ jnp.swapaxes(lever, -1, -2)
        return 0.5 * (found + jnp.swapaxes(found, -1, -2))

    return jax.vmap(one)(noise.sigma, prior, cross, watch.own_m2)
