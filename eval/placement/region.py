"""Where anchors may stand: beside the path, in areas that are allowed, at a height above it."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from eval.placement.plan import Plan
from jaxgeo.errors import InputError

# Projections onto the reach and the areas in turn.
_ROUNDS = 4
# Added to a distance in squares, so that it has a derivative at 0.
_NO_M = 1e-6


class Region(eqx.Module):
    """What is possible.

    Attributes:
        reach_m: anchors stand at most so far from the path, in plan.
        lift_m: their height above it (negative: below).
        edges_m: (e, 2, 2) both ends of every edge of the allowed areas' outlines, in plan; none: everywhere.
    """

    reach_m: Float[Array, ""]
    lift_m: Float[Array, ""]
    edges_m: Float[Array, "e 2 2"]


def region_of(reach_m: float, lift_m: float = 0.0, areas: Sequence[Float[np.ndarray, "_ 2"]] = ()) -> Region:
    """A region; `areas` are outlines (n, 2) in plan, first point not repeated; a point in any of them is allowed.

    Raises:
        InputError: an outline of fewer than three points, or a reach that is not positive.
    """
    if not reach_m > 0.0:
        raise InputError(f"anchors may stand {reach_m} m from the path; expected a positive distance.")
    for number, area in enumerate(areas):
        if area.ndim != 2 or area.shape[1] != 2 or len(area) < 3 or not np.isfinite(area).all():
            raise InputError(
                f"area {number + 1} has shape {area.shape}; expected three points (easting, northing) or more."
            )
    edges = [np.stack([area, np.roll(area, -1, axis=0)], axis=1) for area in areas]
    every = np.concatenate(edges) if edges else np.zeros((0, 2, 2))
    return Region(jnp.asarray(reach_m), jnp.asarray(lift_m), jnp.asarray(every))


def placed(plan_m: Float[Array, "k 2"], plan: Plan, region: Region) -> Float[Array, "k 3"]:
    """Allowed places near some points in plan, with heights.

    Without areas the nearest place within reach of the path. With areas nearest places of the one and of the other in
    turn (alternating projections, von Neumann 1933): always inside an area, and within reach where an area is.
    """
    return jax.vmap(lambda p: _placed(p, plan, region))(plan_m)


def _placed(p: Float[Array, "2"], plan: Plan, region: Region) -> Float[Array, "3"]:
    if region.edges_m.shape[0]:
        for _ in range(_ROUNDS):
            p = _within_reach(p, plan, region)
            p = jnp.where(_inside(p, region.edges_m), p, _on_outline(p, region.edges_m))
    else:
        p = _within_reach(p, plan, region)
    return jnp.append(p, _nearest_on_path(p, plan)[2] + region.lift_m)


def _within_reach(p: Float[Array, "2"], plan: Plan, region: Region) -> Float[Array, "2"]:
    foot = _nearest_on_path(p, plan)
    aside = p - foot[:2]
    distance = jnp.sqrt(jnp.sum(aside**2) + _NO_M**2)
    return foot[:2] + aside * jnp.minimum(1.0, region.reach_m / distance)


def _nearest_on_path(p: Float[Array, "2"], plan: Plan) -> Float[Array, "3"]:
    """The path's point that is nearest in plan, on the edges beside the nearest knot."""
    path = plan.position_m
    knot = jnp.argmin(jnp.sum((path[:, :2] - jax.lax.stop_gradient(p)[None]) ** 2, axis=1))
    knot = jnp.clip(knot, 1, len(plan) - 2)
    ends = jnp.stack([path[knot - 1], path[knot], path[knot + 1]])
    feet = jax.vmap(_foot, in_axes=(None, 0, 0))(p, ends[:2], ends[1:])
    away = jnp.sum((feet[:, :2] - p[None]) ** 2, axis=1)
    return feet[jnp.argmin(jax.lax.stop_gradient(away))]


def _foot(p: Float[Array, "2"], a: Float[Array, "d"], b: Float[Array, "d"]) -> Float[Array, "d"]:
    """The point of the edge a b that is nearest to p in plan."""
    along = (b - a)[:2]
    share = jnp.clip(jnp.sum((p - a[:2]) * along) / jnp.maximum(jnp.sum(along**2), 1e-12), 0.0, 1.0)
    return a + share * (b - a)


def _on_outline(p: Float[Array, "2"], edges: Float[Array, "e 2 2"]) -> Float[Array, "2"]:
    feet = jax.vmap(_foot, in_axes=(None, 0, 0))(p, edges[:, 0], edges[:, 1])
    return feet[jnp.argmin(jax.lax.stop_gradient(jnp.sum((feet - p[None]) ** 2, axis=1)))]


def _inside(p: Float[Array, "2"], edges: Float[Array, "e 2 2"]) -> Array:
    """Even-odd rule: a ray to the east crosses the outlines an odd number of times."""
    a, b = edges[:, 0], edges[:, 1]
    spans = (a[:, 1] > p[1]) != (b[:, 1] > p[1])
    rise = jnp.where(spans, b[:, 1] - a[:, 1], 1.0)
    crossing = a[:, 0] + (p[1] - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return jnp.sum(spans & (crossing > p[0])) % 2 == 1
