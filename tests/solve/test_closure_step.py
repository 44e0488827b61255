"""One step of the solver against dense linear algebra, and its preconditioner."""

import jax
import jax.numpy as jnp
import numpy as np
from solve.closure_grid import closure_grid

from jaxgeo.data import RelativePoses
from jaxgeo.graph.chain import poses_of
from jaxgeo.graph.closure_graph import ClosureGraph, closure_edges, closure_noise, closure_residuals
from jaxgeo.graph.closure_structure import odometry_edges, structure_of
from jaxgeo.solve.closure_cg import Cycle, cycle_of, precondition, solve_joints, spd_inverse
from jaxgeo.solve.closure_inputs import information_roots
from jaxgeo.solve.closure_solver import ClosureState, closure_step

STEP, RESIDUALS = jax.jit(closure_step), jax.jit(closure_residuals)


def graph_of(position: np.ndarray, quat: np.ndarray, edges: RelativePoses) -> ClosureGraph:
    root, definite = information_roots(edges)
    structure = structure_of(len(position), edges.first, edges.second, definite, np.ones(len(edges)))
    rows = closure_edges(edges, root, definite & odometry_edges(edges.first, edges.second))
    m = rows.first.shape[0]
    weight = jnp.asarray((np.arange(m) < len(edges)).astype(float))
    return ClosureGraph(poses_of(position, quat, 128), rows, structure, weight, jnp.zeros(m), jnp.asarray(1.0))


def sparse_grid() -> tuple[np.ndarray, np.ndarray, RelativePoses]:
    """Ten closures: long stretches of poses without any."""
    position, quat, edges = closure_grid(6)
    closure = np.flatnonzero(edges.second - edges.first > 1)
    return position, quat, edges.take(np.concatenate([np.arange(35), closure[:4], closure[-2:]]))


def test_step_is_the_dense_gauss_newton_step_damped_on_the_tree() -> None:
    position, quat, edges = sparse_grid()
    n = len(position)
    # Somewhere, far from the odometry, so that residuals are large everywhere.
    position = position + np.random.default_rng(0).normal(0, 0.3, position.shape)
    graph = graph_of(position, quat, edges)
    assert graph.structure.stretches is not None

    def stacked(y: np.ndarray) -> np.ndarray:
        rows = jnp.asarray(np.pad(y, ((0, 0), (0, 128 - n))))
        return np.stack(RESIDUALS(((rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5])), graph)).T

    # Central differences: compiling the derivative took longer than all else.
    residual, h = stacked(np.zeros((6, n))), 1e-5
    ways = h * np.eye(6 * n).reshape(6 * n, n, 6).transpose(0, 2, 1)[6:]  # the first pose is held
    j = np.stack([(stacked(y) - stacked(-y)) / (2 * h) for y in ways], axis=-1)
    tree = np.asarray(graph.structure.tree)
    noise = closure_noise(graph.base, graph.edges)
    for damping in (0.0, 0.5):
        stiff = (1.0 + damping * tree)[:, None, None] * j
        normal, force = np.einsum("mij,mik->jk", j, stiff), -np.einsum("mij,mi->j", j, residual)
        dense = np.linalg.solve(normal, force)
        state = ClosureState(
            graph.base, noise, jnp.zeros(()), jnp.asarray(damping), jnp.asarray(1e-20), *([jnp.zeros(())] * 5)
        )
        ours, expected, _ = STEP(state, jnp.zeros(()), graph)
        np.testing.assert_allclose(np.asarray(ours)[:, 1:n].T.ravel(), dense, atol=1e-6 * np.abs(dense).max())
        np.testing.assert_array_equal(np.asarray(ours)[:, 0], 0.0)
        np.testing.assert_allclose(expected, 0.5 * force @ dense, rtol=1e-6)


def test_few_joints_are_solved_at_once() -> None:
    """Up to 64 joints the preconditioner is the inverse: a chain with few closures is solved directly."""
    graph = graph_of(*sparse_grid())
    assert graph.structure.levels == ()
    force = np.zeros((len(graph.structure.joint), 6))
    force[1:4] = np.random.default_rng(1).normal(size=(3, 6))
    force[0] = -force.sum(axis=0)
    weight = jnp.broadcast_to(jnp.eye(6), (len(graph.structure.first), 6, 6))
    real = graph.structure.first != graph.structure.second
    weight = weight * jnp.asarray(real, dtype=float)[:, None, None]
    real = np.asarray(real, dtype=float)
    x, steps = jax.jit(solve_joints)(weight, jnp.asarray(force), graph.structure, jnp.asarray(1e-12), jnp.asarray(0.0))
    assert int(steps) <= 2
    pulled = np.zeros_like(force)
    difference = np.asarray(x)[graph.structure.second] - np.asarray(x)[graph.structure.first]
    np.add.at(pulled, np.asarray(graph.structure.second), real[:, None] * difference)
    np.add.at(pulled, np.asarray(graph.structure.first), -real[:, None] * difference)
    np.testing.assert_allclose(pulled, force, atol=1e-9)


def test_cycle_is_symmetric_positive_definite() -> None:
    """With weights that differ by many powers of ten."""
    rng = np.random.default_rng(2)
    n = 200
    extra = rng.integers(0, n, (2, 150))
    first, second = np.concatenate([np.arange(n - 1), extra[0]]), np.concatenate([np.arange(1, n), extra[1]])
    keep = first != second
    first, second = first[keep], second[keep]
    structure = structure_of(n, first, second, np.zeros(len(first), bool), np.ones(len(first)))
    half = rng.normal(size=(len(structure.first), 6, 6)) * 10.0 ** rng.uniform(-2, 2, (len(structure.first), 1, 1))
    real = (structure.first != structure.second)[:, None, None]
    weight = jnp.where(real, jnp.asarray(half @ half.transpose(0, 2, 1)), 0.0)
    cycle = jax.jit(cycle_of)(weight, structure)
    assert len(cycle.levels) == 1
    joints = len(structure.joint)
    ways = jnp.eye(6 * n, 6 * joints).reshape(6 * n, joints, 6)
    matrix = np.asarray(jax.jit(jax.vmap(_applied, in_axes=(None, 0)))(cycle, ways)).reshape(6 * n, -1)[:, : 6 * n]
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9 * np.abs(matrix).max())
    assert np.linalg.eigvalsh(matrix).min() > 0


def _applied(cycle: Cycle, r: jax.Array) -> jax.Array:
    return precondition(cycle, r)


def test_inverses_of_many_blocks_are_lapacks() -> None:
    half = np.random.default_rng(3).normal(size=(50, 6, 6))
    scale = 10.0 ** np.random.default_rng(4).uniform(-4, 4, (50, 6))
    blocks = scale[:, :, None] * (half @ half.transpose(0, 2, 1) + 0.01 * np.eye(6)) * scale[:, None, :]
    found, expected = np.asarray(jax.jit(spd_inverse)(jnp.asarray(blocks))), np.linalg.inv(blocks)
    size = scale[:, :, None] * scale[:, None, :]
    np.testing.assert_allclose(found * size, expected * size, rtol=1e-8, atol=1e-8)
