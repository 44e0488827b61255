"""The closed-form similarity between two sets of points (Umeyama, PAMI 1991), differentiable everywhere."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.geometry.se3 import hat
from jaxgeo.geometry.sim3 import Sim3

_COINCIDENT = 1e-14  # spread against distance from the origin below which points are one point to rounding
_RIDGE = 1e-12  # keeps the derivative of an undetermined rotation finite; relative to the curvature of the fit


class SimilarityFit(eqx.Module):
    """`sim3` maps source to target; `rms_m` is the weighted root mean square of the remaining distances."""

    sim3: Sim3
    rms_m: Float[Array, ""]


@functools.partial(jax.jit, static_argnames=("scale", "gravity"))
def umeyama(
    source_m: Float[Array, "k 3"],
    target_m: Float[Array, "k 3"],
    weights: Float[Array, "k"] | None = None,
    *,
    scale: bool = True,
    gravity: bool = False,
) -> SimilarityFit:
    """The similarity with the least weighted sum of squares of `target - (s R source + t)`; never a reflection.

    Works under `jax.vmap` and `jax.grad`. Points with weight zero do not matter at all, not even as NaN. Where the
    points leave the rotation or scale open (collinear, coincident) the answer is one of the best, with finite
    derivatives: ask `determinacy`.

    Args:
        weights: (k,) not negative; None: all equal.
        scale: estimate the scale; else it is 1. It is also 1 where the best one would not be positive.
        gravity: z axes agree: only the turn about z is estimated.
    """
    weights = jnp.ones(source_m.shape[0]) if weights is None else weights
    total = jnp.sum(weights)
    share = weights / jnp.where(total > 0.0, total, 1.0)
    source_mean, source, source_determined = _centre(source_m, share)
    target_mean, target, target_determined = _centre(target_m, share)
    determined = source_determined & target_determined

    moment = jnp.where(determined, jnp.einsum("k,ki,kj->ij", share, target, source), 0.0)
    rotation = _yaw_rotation(moment) if gravity else nearest_rotation(moment)
    factor = jnp.ones(())
    if scale:
        covariance = jnp.sum(rotation * moment)
        usable = covariance > 0.0
        variance = jnp.sum(share * jnp.sum(source * source, axis=-1))
        factor = jnp.where(usable, covariance, 1.0) / jnp.where(usable, variance, 1.0)
    sim3 = Sim3(factor, rotation, target_mean - factor * (rotation @ source_mean))

    residual = target - factor * jnp.einsum("ij,kj->ki", rotation, source)
    mean_square = jnp.sum(share * jnp.sum(residual * residual, axis=-1))
    positive = mean_square > 0.0
    rms = jnp.where(positive, jnp.sqrt(jnp.where(positive, mean_square, 1.0)), 0.0)
    return SimilarityFit(sim3, rms)


def determinacy(points_m: Float[Array, "k 3"], weights: Float[Array, "k"] | None = None) -> Float[Array, "3"]:
    """Spread of the points along their principal axes (standard deviations, metres), largest first.

    A rotation is determined where the second is well above the noise of the points; with known gravity, where the first
    is, of the points with z set to 0.
    """
    weights = jnp.ones(points_m.shape[0]) if weights is None else weights
    total = jnp.sum(weights)
    share = weights / jnp.where(total > 0.0, total, 1.0)
    _, centred, _ = _centre(points_m, share)
    rows = jnp.concatenate([jnp.sqrt(share)[:, None] * centred, jnp.zeros((3, 3))])
    return jnp.linalg.svd(rows, compute_uv=False)


@jax.custom_jvp
def nearest_rotation(moment: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The rotation R that maximises tr(R^T M), from the singular value decomposition of M; never a reflection.

    Its derivative does not go through the decomposition, which has none at coincident singular values, but through what
    makes R the best: S = R^T M is symmetric. With dR = R hat(w) that gives (tr(S) I - S) w = vee(R^T dM - dM^T R),
    whose matrix has eigenvalues s1+s2, s1+s3, s2+s3 (s3 negative where det M < 0): singular only where R is not
    determined.
    """
    u, _, vt = jnp.linalg.svd(moment)
    sign = jnp.where(jnp.linalg.det(u) * jnp.linalg.det(vt) < 0.0, -1.0, 1.0)
    return u @ jnp.diag(jnp.stack([jnp.ones(()), jnp.ones(()), sign])) @ vt


@nearest_rotation.defjvp
def _nearest_rotation_jvp(primals, tangents):
    (moment,), (d_moment,) = primals, tangents
    rotation = nearest_rotation(moment)
    stretch = rotation.T @ moment
    stretch = 0.5 * (stretch + stretch.T)
    trace = jnp.trace(stretch)
    ridge = jnp.where(trace > 0.0, _RIDGE * trace, 1.0)
    skew = rotation.T @ d_moment
    skew = skew - skew.T
    turn = jnp.linalg.solve((trace + ridge) * jnp.eye(3) - stretch, jnp.stack([skew[2, 1], skew[0, 2], skew[1, 0]]))
    return rotation, rotation @ hat(turn)


def _yaw_rotation(moment: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The rotation about z that maximises tr(R^T M)."""
    cosine, sine = moment[0, 0] + moment[1, 1], moment[1, 0] - moment[0, 1]
    squared = cosine**2 + sine**2
    open_turn = squared <= _COINCIDENT**2 * jnp.sum(moment**2)
    norm = jnp.sqrt(jnp.where(open_turn, 1.0, squared))
    c, s = jnp.where(open_turn, 1.0, cosine / norm), jnp.where(open_turn, 0.0, sine / norm)
    o, one = jnp.zeros(()), jnp.ones(())
    return jnp.stack([c, -s, o, s, c, o, o, o, one]).reshape(3, 3)


def _centre(
    points_m: Float[Array, "k 3"], share: Float[Array, "k"]
) -> tuple[Float[Array, "3"], Float[Array, "k 3"], Array]:
    """Weighted mean, points about it (masked ones zero), and whether they are more than one point."""
    used = (share > 0.0)[:, None]
    points = jnp.where(used, points_m, 0.0)
    mean = share @ points
    centred = jnp.where(used, points - jnp.broadcast_to(mean, points.shape), 0.0)
    spread = jnp.sum(share * jnp.sum(centred * centred, axis=-1))
    size = jnp.sum(share * jnp.sum(points * points, axis=-1))
    return mean, centred, spread > _COINCIDENT**2 * size
