"""Levenberg-Marquardt for marker maps: every step is a dense system of the markers only.

An image pose meets markers, never another image: its 6x6 block is eliminated by itself (Schur complement, Triggs et al.
2000, section 6.1), images in chunks of 32, so that nothing of images times images is built.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree

from jaxgeo.geometry.robust import robust_weight
from jaxgeo.solve.marker_camera import N_GLOBALS
from jaxgeo.solve.marker_map_problem import (
    PRIOR_SIGMA,
    MapPoint,
    MapProblem,
    Unknowns,
    between,
    camera_prior,
    cost_at,
    mean_square,
    moved,
    point_at,
    pose_parts,
    sighting_residual,
    table_rows,
)

CHUNK = 32
_DAMPING_FIRST, _DAMPING_FACTOR, _DAMPING_LOWEST, _DAMPING_HIGHEST = 1e-4, 8.0, 1e-9, 1e9


class Linear(eqx.Module):
    """Residuals and derivatives, each row times the root of its robust weight; zero in the padding."""

    residual: Float[Array, "i k 8"]
    by_image: Float[Array, "i k 8 6"]
    by_marker: Float[Array, "i k 8 6"]
    by_camera: Float[Array, "i k 8 5"]


class Reduced(eqx.Module):
    """The markers' and camera's system, and what gives the images back."""

    matrix: Float[Array, "d d"]
    right: Float[Array, "d"]
    image_inverse: Float[Array, "i 6 6"]
    image_right: Float[Array, "i 6"]


def linearise(point: MapPoint, problem: MapProblem) -> Linear:
    """Weighted residuals and Jacobians at a point."""
    zero = jnp.zeros(6)
    markers = jax.tree.map(lambda x: x[problem.marker], pose_parts(point.markers))

    def one(image, marker, row):
        def at(di, dm, dc):
            return sighting_residual(di, dm, point.camera + dc, image, marker, row)

        arguments = (zero, zero, jnp.zeros(N_GLOBALS))
        return at(*arguments), jax.jacfwd(at, argnums=(0, 1, 2))(*arguments)

    over_sightings = jax.vmap(one, in_axes=(None, 0, 0))
    residual, by = jax.vmap(over_sightings)(pose_parts(point.images), markers, table_rows(problem))
    seen = problem.seen
    residual = jnp.where(seen[..., None], residual, 0.0)
    root = jnp.where(seen, jnp.sqrt(robust_weight(mean_square(residual), problem.loss, problem.width)), 0.0)
    free = problem.free[problem.marker]
    rows = jnp.broadcast_to(root[..., None, None], (*root.shape, 8, 1))
    return Linear(
        residual * root[..., None],
        jnp.where(seen[..., None, None], by[0] * rows, 0.0),
        jnp.where((seen & free)[..., None, None], by[1] * rows, 0.0),
        jnp.where(seen[..., None, None] & problem.refine_camera, by[2] * rows, 0.0),
    )


def reduced_system(linear: Linear, point: MapPoint, problem: MapProblem, damping: Float[Array, ""]) -> Reduced:
    """Normal equations with the images eliminated: S = C - sum_i B_i^T A_i^-1 B_i."""
    m = problem.free.shape[0]
    d = 6 * m + N_GLOBALS
    stretch = 1.0 + damping
    A = jnp.einsum("ikra,ikrb->iab", linear.by_image, linear.by_image)
    A = A + damping * A * jnp.eye(6)[None]
    empty = jnp.trace(A, axis1=1, axis2=2) == 0.0
    A = jnp.where(empty[:, None, None], jnp.eye(6)[None], A)
    inverse = jnp.linalg.inv(A)
    image_right = -jnp.einsum("ikra,ikr->ia", linear.by_image, linear.residual)

    own = jnp.zeros((m, 6, 6)).at[problem.marker].add(jnp.einsum("ikra,ikrb->ikab", linear.by_marker, linear.by_marker))
    cross = (
        jnp.zeros((m, 6, N_GLOBALS))
        .at[problem.marker]
        .add(jnp.einsum("ikra,ikrb->ikab", linear.by_marker, linear.by_camera))
    )
    right_marker = (
        jnp.zeros((m, 6)).at[problem.marker].add(-jnp.einsum("ikra,ikr->ika", linear.by_marker, linear.residual))
    )
    prior = jnp.where(problem.refine_camera, jnp.array(PRIOR_SIGMA) ** -2, 0.0)
    camera = jnp.einsum("ikra,ikrb->ab", linear.by_camera, linear.by_camera) + jnp.diag(prior)
    right_camera = -jnp.einsum("ikra,ikr->a", linear.by_camera, linear.residual)
    right_camera = right_camera - camera_prior(point.camera, problem) / jnp.array(PRIOR_SIGMA)

    index = jnp.arange(m)
    blocks = jnp.zeros((m, 6, m, 6)).at[index, :, index, :].set(own).reshape(6 * m, 6 * m)
    border = cross.reshape(6 * m, N_GLOBALS)
    full = jnp.block([[blocks, border], [border.T, camera]])
    diagonal = jnp.diagonal(full)
    full = full + jnp.diag(jnp.where(diagonal > 0.0, (stretch - 1.0) * diagonal, 1.0))  # held: 1
    right = jnp.concatenate([right_marker.reshape(-1), right_camera])
    return _eliminated(full, right, inverse, image_right, linear, problem, d)


def _coupling(
    marker: Array, by_image: Float[Array, "c k 8 6"], by_marker: Array, by_camera: Array, d: int
) -> Float[Array, "c 6 d"]:
    """B of a chunk of images: their rows of the normal matrix over markers and camera."""
    c = marker.shape[0]
    entries = jnp.einsum("ckra,ckrb->ckab", by_image, by_marker)
    over = jnp.zeros((c, (d - N_GLOBALS) // 6, 6, 6)).at[jnp.arange(c)[:, None], marker].add(entries)
    over = jnp.swapaxes(over, 1, 2).reshape(c, 6, d - N_GLOBALS)
    return jnp.concatenate([over, jnp.einsum("ckra,ckrb->cab", by_image, by_camera)], axis=2)


def _chunks(linear: Linear, problem: MapProblem, *others: Array) -> tuple:
    arrays = (problem.marker, linear.by_image, linear.by_marker, linear.by_camera, *others)
    return tuple(x.reshape(-1, CHUNK, *x.shape[1:]) for x in arrays)


def _eliminated(full, right, inverse, image_right, linear: Linear, problem: MapProblem, d: int) -> Reduced:
    def subtract(carry, chunk):
        marker, by_image, by_marker, by_camera, inv, rhs = chunk
        B = _coupling(marker, by_image, by_marker, by_camera, d)
        solved = jnp.einsum("cab,cbd->cad", inv, B)
        matrix, vector = carry
        flat = B.reshape(-1, d)
        return (matrix - flat.T @ solved.reshape(-1, d), vector - jnp.einsum("cad,ca->d", solved, rhs)), None

    (matrix, vector), _ = jax.lax.scan(subtract, (full, right), _chunks(linear, problem, inverse, image_right))
    return Reduced(0.5 * (matrix + matrix.T), vector, inverse, image_right)


def solve_reduced(reduced: Reduced, right: Float[Array, "d *e"]) -> Float[Array, "d *e"]:
    """Cholesky after scaling to unit diagonal: metres, radians and pixels differ in size. NaN where not positive."""
    scale = jax.lax.rsqrt(jnp.diagonal(reduced.matrix))
    lower = jnp.linalg.cholesky(reduced.matrix * scale[:, None] * scale[None])
    shaped = scale.reshape(-1, *([1] * (right.ndim - 1)))
    return shaped * jax.scipy.linalg.cho_solve((lower, True), shaped * right)


def step_from(reduced: Reduced, linear: Linear, problem: MapProblem) -> Unknowns:
    """Markers and camera from the reduced system, then every image from its own block."""
    d = reduced.right.shape[0]
    x = solve_reduced(reduced, reduced.right)

    def back(_, chunk):
        marker, by_image, by_marker, by_camera, inv, rhs = chunk
        B = _coupling(marker, by_image, by_marker, by_camera, d)
        return None, jnp.einsum("cab,cb->ca", inv, rhs - jnp.einsum("cad,d->ca", B, x))

    _, images = jax.lax.scan(back, None, _chunks(linear, problem, reduced.image_inverse, reduced.image_right))
    return Unknowns(images.reshape(-1, 6), x[:-N_GLOBALS].reshape(-1, 6), x[-N_GLOBALS:])


class State(eqx.Module):
    """The last accepted point and what to try next."""

    point: MapPoint
    cost: Float[Array, ""]
    damping: Float[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]


class MarkerMapLM(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt on the reduced system of the markers; `args` must be the `MapProblem`.

    Damping multiplies the diagonal of the normal matrix by 1 + mu (Marquardt). Converged: a step with damping below
    1e-3 lowers the cost by less than `rtol * cost + atol`, or raises it by no more than that. A trial that is not
    finite or raises the cost is rejected; damping past 1e9 ends the solve as divergent.
    """

    rtol: float = 1e-10
    atol: float = 1e-10
    norm: Callable[[PyTree], Array] = optx.max_norm

    def init(
        self, fn: Any, y: Unknowns, args: MapProblem, options: dict, f_struct: Any, aux_struct: Any, tags: frozenset
    ) -> State:
        point = point_at(y, args)
        false = jnp.array(False)
        return State(point, cost_at(point, args), jnp.array(_DAMPING_FIRST), false, false)

    def step(
        self, fn: Any, y: Unknowns, args: MapProblem, options: dict, state: State, tags: frozenset
    ) -> tuple[Unknowns, State, Any]:
        linear = linearise(state.point, args)
        delta = step_from(reduced_system(linear, state.point, args, state.damping), linear, args)
        trial = MapPoint(
            moved(state.point.images, delta.image),
            moved(state.point.markers, delta.marker),
            state.point.camera + delta.camera,
        )
        cost = cost_at(trial, args)
        finite = jnp.isfinite(cost)
        accept = finite & (cost <= state.cost)
        slack = self.rtol * state.cost + self.atol
        converged = finite & (jnp.abs(state.cost - cost) <= slack) & (state.damping < 1e-3)
        damping = jnp.where(accept, state.damping / _DAMPING_FACTOR, state.damping * _DAMPING_FACTOR)
        damping = jnp.maximum(damping, _DAMPING_LOWEST)
        point = jax.tree.map(lambda new, old: jnp.where(accept, new, old), trial, state.point)
        stuck = ~converged & (damping > _DAMPING_HIGHEST)
        return y, State(point, jnp.where(accept, cost, state.cost), damping, converged, stuck), None

    def terminate(
        self, fn: Any, y: Unknowns, args: MapProblem, options: dict, state: State, tags: frozenset
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.converged | state.stuck, result

    def postprocess(
        self,
        fn: Any,
        y: Unknowns,
        aux: Any,
        args: MapProblem,
        options: dict,
        state: State,
        tags: frozenset,
        result: optx.RESULTS,
    ) -> tuple[Unknowns, Any, dict[str, Any]]:
        images = between(state.point.images, args.base.images)
        markers = between(state.point.markers, args.base.markers)
        return Unknowns(images, markers, state.point.camera - args.base.camera), aux, {}
