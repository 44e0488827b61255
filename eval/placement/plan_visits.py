"""When a planned path passes a marker: places along it, and how well the marker is seen from there."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from eval.placement.plan import Plan, between_knots, position_at

# Passes of one marker that count; a path that comes by more often gains little from the rest.
MOST_PASSES = 4
# Share of the visibility range over which sight fades, so that accuracy is a smooth function of where a marker stands.
FADE = 0.25
# Added to a distance in squares, so that it has a derivative at 0.
_NO_M = 1e-9


class Sight(eqx.Module):
    """What is known of markers before there are any.

    Attributes:
        range_m: a marker is seen from so far.
        sigma_m: of one visit's sighting, each axis: scatter, lever arm, PnP.
        survey_sigma_m: (3,) easting, northing, height: one draw for all visits of a marker.
        apart_m: passes nearer to each other along the path are one visit.
    """

    range_m: Float[Array, ""]
    sigma_m: Float[Array, ""]
    survey_sigma_m: Float[Array, "3"]
    apart_m: Float[Array, ""]


class Visits(eqx.Module):
    """Visits of markers, up to some passes each, flattened; a pass that does not happen has `seen` 0.

    Attributes:
        place: (v,) along the path.
        point_m: (v, 3) the marker's position.
        seen: (v,) 0 .. 1: the sighting's standard deviation is divided by it.
        location: (v,) which marker.
    """

    place: Float[Array, "v"]
    point_m: Float[Array, "v 3"]
    seen: Float[Array, "v"]
    location: Int[Array, "v"]


def plan_visits(point_m: Float[Array, "k 3"], plan: Plan, sight: Sight, passes: int = MOST_PASSES) -> Visits:
    """The nearest passes of every marker.

    A pass is a knot nearer than its neighbours, the nearest first, and farther than `apart_m` along the path from those
    before; its place is then moved to the nearest point of the two edges beside it, which makes it continuous in the
    marker's position.
    """

    def one(point: Float[Array, "3"]) -> tuple[Array, Array]:
        away = jnp.sum(jax.lax.stop_gradient(plan.position_m - point[None]) ** 2, axis=1)
        # Of poses as near as each other the first is the pass.
        nearer = (away < jnp.roll(away, 1)).at[0].set(True) & (away <= jnp.roll(away, -1)).at[-1].set(True)
        left, knots, away2 = jnp.where(nearer, away, jnp.inf), [], []
        for _ in range(passes):
            knots.append(jnp.argmin(left))
            away2.append(left[knots[-1]])
            apart = jnp.abs(plan.distance_m - plan.distance_m[knots[-1]]) > sight.apart_m
            left = jnp.where(apart, left, jnp.inf)
        place = _foot(point, jnp.stack(knots), plan)
        happens = jnp.isfinite(jnp.stack(away2))
        return place, jnp.where(happens, seen_from(position_at(plan, place), point, sight), 0.0)

    place, seen = jax.vmap(one)(point_m)
    location = jnp.repeat(jnp.arange(point_m.shape[0]), passes)
    return Visits(place.reshape(-1), point_m[location], seen.reshape(-1), location)


def seen_from(position_m: Float[Array, "p 3"], point_m: Float[Array, "3"], sight: Sight) -> Float[Array, "p"]:
    """How well a marker is seen from some positions: 1 well within the range, 0 beyond it, smooth at both ends."""
    away = position_m - point_m[None]
    distance = jnp.sqrt(jnp.sum(away**2, axis=1) + _NO_M**2)
    near = jnp.clip((sight.range_m - distance) / (FADE * sight.range_m), 0.0, 1.0)
    return near * near * (3.0 - 2.0 * near)


def _foot(point: Float[Array, "3"], knot: Int[Array, "p"], plan: Plan) -> Float[Array, "p"]:
    """Nearest place on the edges before and after some knots."""
    n = len(plan)

    def on_edge(first: Array) -> tuple[Array, Array]:
        a, b = plan.position_m[first], plan.position_m[first + 1]
        along = b - a
        length2 = jnp.maximum(jnp.sum(along * along, axis=1), 1e-12)
        share = jnp.clip(jnp.sum((point[None] - a) * along, axis=1) / length2, 0.0, 1.0)
        away = jax.lax.stop_gradient(a + share[:, None] * along - point[None])
        return first.astype(float) + share, jnp.sum(away**2, axis=1)

    before, far_before = on_edge(jnp.clip(knot - 1, 0, n - 2))
    after, far_after = on_edge(jnp.clip(knot, 0, n - 2))
    return jnp.where(far_before < far_after, before, after)


def distance_of(visits: Visits, plan: Plan) -> Float[Array, "v"]:
    """How far along the path every visit happens."""
    return between_knots(plan.distance_m, visits.place)
