"""Conjugate gradients on the joints of a large graph, preconditioned by ever coarser graphs of rigid groups.

One cycle smooths with damped block Jacobi, gathers what is left on groups of poses that move as one, solves that graph
the same way (the last one by Cholesky), and smooths again. The inverse of the chain alone, or of the diagonal blocks,
took ten to a hundred times as many iterations on graphs with thousands of closures: see docs/pose-graphs.md.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float

from jaxgeo.graph.closure_levels import Coarsest, Level
from jaxgeo.graph.closure_structure import Structure

# Block Jacobi's damping: D^-1 H has eigenvalues up to 2, exactly, so that anything below 1 keeps the cycle definite.
_SMOOTHING = 0.8
# Rigid groups are too stiff: the coarse correction comes out too short (Braess, Computing 1995). Any factor up to 2
# keeps the cycle definite; with 1.5 a quarter of the iterations were saved against 1.
_OVERCORRECTION = 1.5
# Visits of every middle level (a W cycle): against one visit, a third of the iterations for a third more time in each.
_VISITS = 2
# The last graph has the gauge as its null space; its first group is held, a thousandth as stiffly as it is tied.
_HOLD = 1e-3


class Laplacian(eqx.Module):
    """`H = sum_e (e_second - e_first) W_e (e_second - e_first)'` over blocks of six."""

    weight: Float[Array, "e 6 6"]
    first: Array
    second: Array


class CycleLevel(eqx.Module):
    """A graph, its blocks' inverses, and how it is made coarser."""

    laplacian: Laplacian
    inverse_blocks: Float[Array, "n 6 6"]
    level: Level


class Cycle(eqx.Module):
    """The whole preconditioner. `inverse`: of the last graph's matrix, (6k, 6k)."""

    levels: tuple[CycleLevel, ...]
    inverse: Float[Array, "s s"]


def product(h: Laplacian, x: Float[Array, "n 6"]) -> Float[Array, "n 6"]:
    """`H x`."""
    force = jnp.einsum("eab,eb->ea", h.weight, x[h.second] - x[h.first])
    return jnp.zeros_like(x).at[h.second].add(force).at[h.first].add(-force)


def cycle_of(weight: Float[Array, "e 6 6"], structure: Structure) -> Cycle:
    """The preconditioner of the joints' matrix with the given weights."""
    levels = []
    for level in structure.levels:
        n = level.group.shape[0]
        h = Laplacian(weight, level.first, level.second)
        levels.append(CycleLevel(h, spd_inverse(diagonal_blocks(h, n)), level))
        weight = jnp.zeros((level.counts[1], 6, 6)).at[level.coarse_edge].add(weight, mode="drop")
    return Cycle(tuple(levels), _dense_inverse(weight, structure.coarsest))


def diagonal_blocks(h: Laplacian, n: int) -> Float[Array, "n 6 6"]:
    """The 6x6 blocks on H's diagonal; the identity where a node has no edges (padding)."""
    blocks = jnp.zeros((n, 36))
    rows = jnp.where((h.first != h.second)[:, None], h.weight.reshape(-1, 36), 0.0)
    blocks = blocks.at[h.first].add(rows).at[h.second].add(rows).reshape(n, 6, 6)
    alone = jnp.trace(blocks, axis1=1, axis2=2) <= 0
    return jnp.where(alone[:, None, None], jnp.broadcast_to(jnp.eye(6), blocks.shape), blocks)


def _dense_inverse(weight: Float[Array, "e 6 6"], coarsest: Coarsest) -> Float[Array, "s s"]:
    k = coarsest.real.shape[0]
    h = Laplacian(weight, coarsest.first, coarsest.second)
    diagonal = diagonal_blocks(h, k)
    diagonal = diagonal.at[0].multiply(1.0 + _HOLD)
    index = jnp.arange(k)
    blocks = jnp.zeros((k, k, 6, 6)).at[index, index].set(diagonal)
    between = jnp.where((h.first != h.second)[:, None, None], weight, 0.0)
    blocks = blocks.at[h.first, h.second].add(-between).at[h.second, h.first].add(-between)
    matrix = blocks.transpose(0, 2, 1, 3).reshape(6 * k, 6 * k)
    # Unit diagonal first: metres and radians differ by many powers of ten.
    scale = 1.0 / jnp.sqrt(jnp.diagonal(matrix))
    factor = jnp.linalg.cholesky(matrix * scale[:, None] * scale[None, :])
    half = jax.scipy.linalg.solve_triangular(factor, jnp.diag(scale), lower=True)
    return half.T @ half


def spd_inverse(blocks: Float[Array, "n 6 6"]) -> Float[Array, "n 6 6"]:
    """Inverses of many small symmetric positive definite blocks, by Gauss-Jordan elimination on all of them at once.

    LAPACK, block by block, took ten times as long.
    """
    scale = 1.0 / jnp.sqrt(jnp.diagonal(blocks, axis1=1, axis2=2))
    scales = scale[:, :, None] * scale[:, None, :]

    def eliminated(k: Array, a: Array) -> Array:
        pivot = 1.0 / jnp.maximum(a[:, k, k], 1e-14)
        column, row = a[:, :, k], a[:, k, :] * pivot[:, None]
        a = a - column[:, :, None] * row[:, None, :]
        a = a.at[:, :, k].set(-column * pivot[:, None]).at[:, k, :].set(row)
        return a.at[:, k, k].set(pivot)

    inverse = jax.lax.fori_loop(0, blocks.shape[-1], eliminated, blocks * scales)
    return 0.5 * (inverse + jnp.swapaxes(inverse, 1, 2)) * scales


def precondition(cycle: Cycle, r: Float[Array, "n 6"], at: int = 0) -> Float[Array, "n 6"]:
    """One cycle from zero: a symmetric positive definite stand-in for the inverse."""
    if at == len(cycle.levels):
        return (cycle.inverse @ r.reshape(-1)).reshape(r.shape)
    level = cycle.levels[at]

    def smoothed(r: Array) -> Array:
        return _SMOOTHING * jnp.einsum("nab,nb->na", level.inverse_blocks, r)

    group = level.level.group
    x = smoothed(r)
    rest = r - product(level.laplacian, x)
    on_groups = jnp.zeros((level.level.counts[0], 6)).at[group].add(rest, mode="drop")
    moved = _visited(cycle, on_groups, at + 1)
    x = x + _OVERCORRECTION * moved.at[group].get(mode="fill", fill_value=0.0)
    return x + smoothed(r - product(level.laplacian, x))


def _visited(cycle: Cycle, r: Float[Array, "n 6"], at: int) -> Float[Array, "n 6"]:
    """Cycles of a coarser level from zero, as a loop: written out, the program would double with every level."""
    if at == len(cycle.levels):
        return precondition(cycle, r, at)
    h = cycle.levels[at].laplacian
    return jax.lax.fori_loop(0, _VISITS, lambda _, x: x + precondition(cycle, r - product(h, x), at), jnp.zeros_like(r))


class ClosureCG(lx.AbstractLinearSolver):
    """Preconditioned conjugate gradients for symmetric positive semidefinite operators, stopped by what they minimise.

    After k steps the model `Q = b'x - x'Hx / 2` has grown by the last one's gain; enough is where
    `k gain <= tolerance Q` (Nash and Sofer, Assessing a search direction within a truncated-Newton method, Operations
    Research Letters 1990), or `floor`: at the optimum the forces are rounding, and solving for them would follow the
    gauge out of sight. lineax's own CG stops by single entries of residual and solution, which have several units here.
    `options["preconditioner"]` must be positive semidefinite too.
    """

    tolerance: Array | float
    floor: Array | float = 0.0
    max_steps: int = 300

    def init(self, operator: lx.AbstractLinearOperator, options: dict) -> Any:
        return operator

    def compute(self, state: Any, vector: Array, options: dict) -> tuple[Array, lx.RESULTS, dict]:
        operator, preconditioner = state, options["preconditioner"]

        def unfinished(carry: tuple) -> Bool[Array, ""]:
            *_, gain, grown, k = carry
            return (jnp.maximum(k, 1) * gain > jnp.maximum(self.tolerance * grown, self.floor)) & (k < self.max_steps)

        def iterate(carry: tuple) -> tuple:
            x, r, p, rz_before, _, grown, k = carry
            z = preconditioner.mv(r)
            rz = jnp.vdot(r, z)
            p = z + (rz / rz_before) * p
            hp = operator.mv(p)
            worth_it = rz > self.floor
            alpha = jnp.where(worth_it, rz / jnp.where(worth_it, jnp.vdot(p, hp), 1.0), 0.0)
            gain = 0.5 * alpha * rz
            return x + alpha * p, r - alpha * hp, p, rz, gain, grown + gain, k + 1

        zero, infinite = jnp.zeros_like(vector), jnp.array(jnp.inf)
        # The first gain is taken as infinite, and the direction before the first as none.
        start = (zero, vector, zero, infinite, infinite, jnp.zeros(()), jnp.array(0))
        x, *_, k = jax.lax.while_loop(unfinished, iterate, start)
        return x, lx.RESULTS.successful, {"num_steps": k}

    def transpose(self, state: Any, options: dict) -> tuple[Any, dict]:
        return state, options  # symmetric

    def conj(self, state: Any, options: dict) -> tuple[Any, dict]:
        return state, options  # and real

    def assume_full_rank(self) -> bool:
        return True


def solve_joints(
    weight: Float[Array, "e 6 6"], force: Float[Array, "n 6"], structure: Structure, tolerance: Array, floor: Array
) -> tuple[Float[Array, "n 6"], Array]:
    """Increments of the joints under forces on them, and the iterations used; the limits are those of `ClosureCG`."""
    cycle = cycle_of(weight, structure)
    h = Laplacian(weight, structure.first, structure.second)
    like = jax.eval_shape(lambda: force)
    symmetric = lx.positive_semidefinite_tag
    found = lx.linear_solve(
        lx.FunctionLinearOperator(lambda x: product(h, x), like, symmetric),
        force,
        ClosureCG(tolerance, floor),
        options={"preconditioner": lx.FunctionLinearOperator(lambda r: precondition(cycle, r), like, symmetric)},
        throw=False,
    )
    return found.value, found.stats["num_steps"]
