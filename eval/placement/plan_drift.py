"""Prior covariances of points that a planned path carries or sees, at any places along it, under every noise set."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from eval.placement.plan import Plan, between_knots
from jaxgeo.graph.components import (
    BIAS_ROT,
    BIAS_TRANS,
    BOUNDED,
    LOG_SCALE,
    LOG_TURN,
    N_WHITE,
    WANDER_ROT,
    WANDER_SCALE,
    WANDER_TRANS,
    NoiseEnsemble,
)
from jaxgeo.solve.drift import BLOCKS
from jaxgeo.solve.linearise import hat

_CONSTANTS = np.array([BIAS_TRANS] * 3 + [BIAS_ROT] * 3 + [LOG_SCALE, LOG_TURN])
_WANDERS = np.array([WANDER_TRANS] * 3 + [WANDER_ROT] * 3 + [WANDER_SCALE])


class Places(eqx.Module):
    """Points at p places of a path, and what unit drift does to them; their prior under the q sets of a noise.

    Attributes:
        place: (p,) real knot numbers, and `distance_m` (p,) along the path.
        jacobian: (p, 3, 6) of the points in the poses' world-frame increments.
        white: (q, p, 6, 6) covariance of the poses' increments from all white noise.
        constant, wander: (q, p, 3, 8), (q, p, 3, b, 7) influence on the points, times the sigmas.
    """

    place: Float[Array, "p"]
    distance_m: Float[Array, "p"]
    jacobian: Float[Array, "p 3 6"]
    white: Float[Array, "q p 6 6"]
    constant: Float[Array, "q p 3 8"]
    wander: Float[Array, "q p 3 b 7"]


def carried(plan: Plan, noise: NoiseEnsemble, place: Float[Array, "p"], point_m: Float[Array, "p 3"]) -> Places:
    """Points that the path carries, or sees, at some places."""
    eye = jnp.broadcast_to(jnp.eye(3), (*point_m.shape, 3))
    jacobian = jnp.concatenate([eye, -hat(point_m)], axis=-1)
    white = jnp.einsum("qc,cpab->qpab", noise.sigma[:, :N_WHITE] ** 2, between_knots(plan.white, place, axis=1))
    constant = jnp.einsum("pia,pac->pic", jacobian, between_knots(plan.constant, place))
    constant = constant[None] * noise.sigma[:, None, None, _CONSTANTS]
    wander = jnp.zeros((noise.weight.shape[0], place.shape[0], 3, 0, 7))
    if plan.wanders:
        upto = between_knots(plan.constant[..., :7], jnp.minimum(place[:, None], plan.block_end[None]).reshape(-1))
        upto = upto.reshape(place.shape[0], BLOCKS, 6, 7)
        part = upto - jnp.concatenate([jnp.zeros_like(upto[:, :1]), upto[:, :-1]], axis=1)
        part = jnp.einsum("pia,pbac->pibc", jacobian, part)
        wander = part[None] * noise.sigma[:, None, None, None, _WANDERS]
    return Places(place, between_knots(plan.distance_m, place), jacobian, white, constant, wander)


def covariance_of(here: Places, there: Places, plan: Plan, noise: NoiseEnsemble) -> Float[Array, "q x y"]:
    """Prior covariance between points at two lists of places, one matrix a set; x and y three rows a point."""
    q, p, k = noise.weight.shape[0], here.place.shape[0], there.place.shape[0]
    later = jnp.einsum("qlab,leb->qlae", there.white, there.jacobian)
    later = jnp.einsum("ida,qlae->qidle", here.jacobian, later)
    earlier = jnp.einsum("ida,qiab->qidb", here.jacobian, here.white)
    earlier = jnp.einsum("qidb,leb->qidle", earlier, there.jacobian)
    first = (there.place[None, :] <= here.place[:, None])[None, :, None, :, None]
    total = jnp.where(first, later, earlier) + jnp.einsum("qpic,qkjc->qpikj", here.constant, there.constant)
    near = jnp.exp(-jnp.abs(here.distance_m[:, None] - there.distance_m[None, :]) / noise.correlation_m)
    bounded = noise.sigma[:, BOUNDED] ** 2
    total = total + bounded[:, None, None, None, None] * (
        near[None, :, None, :, None] * jnp.eye(3)[None, None, :, None, :]
    )
    if plan.wanders:
        spread = jnp.einsum("bd,qkjdc->qkjbc", _block_correlation(plan, noise), there.wander)
        total = total + jnp.einsum("qpibc,qkjbc->qpikj", here.wander, spread)
    return total.reshape(q, 3 * p, 3 * k)


def own_covariance(here: Places, plan: Plan, noise: NoiseEnsemble) -> Float[Array, "q p 3 3"]:
    """The blocks of `covariance_of` of every point with itself."""
    total = jnp.einsum("pia,qpab,pjb->qpij", here.jacobian, here.white, here.jacobian)
    total = total + jnp.einsum("qpic,qpjc->qpij", here.constant, here.constant)
    total = total + (noise.sigma[:, BOUNDED] ** 2)[:, None, None, None] * jnp.eye(3)[None, None]
    if plan.wanders:
        spread = jnp.einsum("bd,qpjdc->qpjbc", _block_correlation(plan, noise), here.wander)
        total = total + jnp.einsum("qpibc,qpjbc->qpij", here.wander, spread)
    return total


def _block_correlation(plan: Plan, noise: NoiseEnsemble) -> Float[Array, "b b"]:
    step = jnp.arange(BLOCKS).astype(float)
    block_m = plan.distance_m[-1] / BLOCKS
    return jnp.exp(-jnp.abs(step[:, None] - step[None, :]) * block_m / noise.correlation_m)
