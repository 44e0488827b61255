"""The similarity between two sets of points by least squares: full covariances, robust loss, covariance of the fit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from jaxgeo.geometry.robust import RobustKind, check_robust, robust_residual, robust_weight
from jaxgeo.geometry.se3 import hat, so3_exp, so3_matrix
from jaxgeo.geometry.sim3 import Sim3, sim3_apply
from jaxgeo.geometry.umeyama import umeyama

_SOLVER = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
# The pseudo-inverse keeps gradients finite where the points leave a direction open.
_ADJOINT = optx.ImplicitAdjoint(lx.AutoLinearSolver(well_posed=False))
_RIDGE = 1e-14  # relative; an undetermined parameter then has a huge, finite variance


class Alignment(eqx.Module):
    """A fitted similarity.

    Attributes:
        sim3: maps source to target.
        covariance: (7, 7) of (translation added, rotation multiplied on the left, log-scale added), target axes;
            zero rows for what was held fixed. Taken at the solution with the robust weights.
        residual_m: (k, 3) target minus mapped source; zero where masked.
        weight: (k,) robust weight of each point, 1 where it is trusted fully, 0 where masked.
        cost: half the sum of rho.
        result: the solver's result code: gate on it.
        steps: solver steps.
    """

    sim3: Sim3
    covariance: Float[Array, "7 7"]
    residual_m: Float[Array, "k 3"]
    weight: Float[Array, "k"]
    cost: Float[Array, ""]
    result: optx.RESULTS
    steps: Array


class AlignmentProblem(eqx.Module):
    """What `alignment_residual` needs: points, whitening (zero where masked), and where increments start."""

    source_m: Float[Array, "k 3"]
    target_m: Float[Array, "k 3"]
    whitening: Float[Array, "k 3 3"]
    start: Sim3
    centre_m: Float[Array, "3"]
    free: Float[Array, "7 p"]
    width: Float[Array, ""]
    loss: RobustKind = eqx.field(static=True)


@eqx.filter_jit
def align(
    source_m: Float[Array, "k 3"],
    target_m: Float[Array, "k 3"],
    covariance_m2: Float[Array, "k 3 3"],
    mask: Bool[Array, "k"] | None = None,
    *,
    scale: bool = True,
    gravity: bool = False,
    loss: RobustKind = "none",
    width: float = 3.0,
    max_steps: int = 500,
) -> Alignment:
    """The similarity with the least `1/2 sum rho(r^T C^-1 r)`, `r = target - (s R source + t)`.

    Started from the closed form, so a bounded loss (`geman_mcclure`) finds the best fit only near it.

    Args:
        covariance_m2: of `target - mapped source`, target axes.
        mask: (k,) True for the points to use; the others do not matter at all, not even as NaN.
        scale, gravity: as in `umeyama`.
        loss, width: robust loss and its width in standard deviations.

    Raises:
        ConfigError: unknown loss. A solve that fails does not raise: read `result`.
    """
    check_robust(loss, width)
    used = jnp.ones(source_m.shape[0], dtype=bool) if mask is None else mask
    source = jnp.where(used[:, None], source_m, 0.0)
    target = jnp.where(used[:, None], target_m, 0.0)
    eye = jnp.broadcast_to(jnp.eye(3), covariance_m2.shape)
    covariance = jnp.where(used[:, None, None], covariance_m2, eye)
    whitening = jnp.where(used[:, None, None], jnp.linalg.inv(jnp.linalg.cholesky(covariance)), 0.0)

    # The start is a constant to the derivative: the optimum does not depend on it.
    weights = jnp.where(used, 3.0 / jnp.trace(covariance, axis1=-2, axis2=-1), 0.0)
    start = jax.lax.stop_gradient(umeyama(source, target, weights, scale=scale, gravity=gravity).sim3)
    centre = jax.lax.stop_gradient(weights @ source / jnp.maximum(jnp.sum(weights), 1e-300))
    free = _free_directions(scale, gravity)
    problem = AlignmentProblem(source, target, whitening, start, centre, free, jnp.asarray(width, float), loss)
    solution = optx.least_squares(
        alignment_residual,
        _SOLVER,
        jnp.zeros(free.shape[1]),
        problem,
        max_steps=max_steps,
        adjoint=_ADJOINT,
        throw=False,
    )
    sim3 = _retract(problem, solution.value)
    return _summarise(problem, sim3, used, solution.result, solution.stats["num_steps"])


def alignment_residual(increment: Float[Array, "p"], problem: AlignmentProblem) -> Float[Array, "k 3"]:
    """Whitened target minus mapped source, shortened by the robust loss."""
    return robust_residual(_white_residual(increment, problem), problem.loss, problem.width)


def _white_residual(increment: Float[Array, "p"], problem: AlignmentProblem) -> Float[Array, "k 3"]:
    residual = problem.target_m - sim3_apply(_retract(problem, increment), problem.source_m)
    return jnp.einsum("kij,kj->ki", problem.whitening, residual)


def _retract(problem: AlignmentProblem, increment: Float[Array, "p"]) -> Sim3:
    """Turn and scale about the points' own centre: there the increments hardly correlate, wherever the origin is."""
    delta = problem.free @ increment
    start = problem.start
    rotation = so3_matrix(so3_exp(delta[3:6])) @ start.rotation
    scale = start.scale * jnp.exp(delta[6])
    image = sim3_apply(start, problem.centre_m) + delta[:3]
    return Sim3(scale, rotation, image - scale * (rotation @ problem.centre_m))


def _summarise(problem: AlignmentProblem, sim3: Sim3, used: Array, result: optx.RESULTS, steps: Array) -> Alignment:
    at_solution = eqx.tree_at(lambda p: p.start, problem, sim3)
    zero = jnp.zeros(problem.free.shape[1])
    white = _white_residual(zero, at_solution)
    squared = jnp.sum(white * white, axis=-1)
    weight = jnp.where(used, robust_weight(squared, problem.loss, problem.width), 0.0)
    jacobian = jax.jacfwd(_white_residual)(zero, at_solution)
    information = jnp.einsum("k,kip,kiq->pq", weight, jacobian, jacobian)
    cost = 0.5 * jnp.sum(alignment_residual(zero, at_solution) ** 2)
    residual = jnp.where(used[:, None], problem.target_m - sim3_apply(sim3, problem.source_m), 0.0)

    # From increments about the centre to those of (t, R, log s): t = image - s R centre.
    lever = sim3.scale * (sim3.rotation @ problem.centre_m)
    about_origin = jnp.eye(7).at[:3, 3:6].set(hat(lever)).at[:3, 6].set(-lever) @ problem.free
    covariance = about_origin @ _inverse(information) @ about_origin.T
    return Alignment(sim3, covariance, residual, weight, cost, result, steps)


def _inverse(information: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Inverse after scaling to a unit diagonal, since metres and radians differ by orders of magnitude."""
    diagonal = jnp.diagonal(information)
    root = jnp.sqrt(jnp.where(diagonal > 0.0, diagonal, 1.0))
    outer = root[:, None] * root[None, :]
    size = information.shape[0]
    return jnp.linalg.inv(information / outer + _RIDGE * jnp.eye(size)) / outer


def _free_directions(scale: bool, gravity: bool) -> Float[Array, "7 p"]:
    """Columns of the 7 parameters (translation, rotation, log-scale) that are estimated."""
    columns = [0, 1, 2, *((5,) if gravity else (3, 4, 5)), *((6,) if scale else ())]
    return jnp.asarray(np.eye(7)[:, columns])
