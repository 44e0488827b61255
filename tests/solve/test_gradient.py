"""Gradients of the solution against central differences, and the two operators that they are made of."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.chain_session import graph_of
from solve.dense_oracle import dense_factor, dense_system, edge_coordinates
from solve.programs import EVERYTHING, optimum, session_of_everything

from jaxgeo.graph.chain import Poses
from jaxgeo.graph.pose_graph import (
    Globals,
    Increments,
    PoseGraph,
    globals_at,
    increment_rows,
    increments_of,
    poses_at,
)
from jaxgeo.solve.adjoint import gauss_newton_solve, linearisation, rebased
from jaxgeo.solve.hessian import hessian_product
from jaxgeo.solve.solver import solve_graph_differentiably

N, PADDED, G = 100, 128, 7


@pytest.fixture(scope="module")
def graph() -> PoseGraph:
    return graph_of(session_of_everything(N), EVERYTHING)


@pytest.fixture(scope="module")
def at_optimum(graph) -> PoseGraph:
    return optimum(graph)


def number_of(poses: Poses, glob: Globals) -> jax.Array:
    """Some number of everything that is solved for, none of it at an extremum."""
    weight = np.sin(np.arange(PADDED) * 0.37)
    found = sum(i * jnp.sum(weight * c) for i, c in enumerate(poses.t, start=1))
    found = found + sum(30.0 * i * jnp.sum(weight * c) for i, c in enumerate(poses.quat, start=1))
    found = found + 100.0 * sum(i * b for i, b in enumerate(glob.bias_trans, start=1))
    return found + 500.0 * sum(i * b for i, b in enumerate(glob.bias_rot, start=1)) + 40.0 * glob.log_scale


@eqx.filter_jit
@eqx.filter_value_and_grad
def value_and_gradient(graph: PoseGraph) -> jax.Array:
    found = solve_graph_differentiably(graph)
    return number_of(found.poses, found.glob)


def value(graph: PoseGraph) -> float:
    found = optimum(graph)
    return float(number_of(found.base, found.base_globals))


def central_difference(graph: PoseGraph, moved, step: float) -> float:
    """By Richardson, of fourth order; `moved(graph, h)` is the graph with one number changed by h."""
    once, twice = ((value(moved(graph, h)) - value(moved(graph, -h))) / (2.0 * h) for h in (step, 2.0 * step))
    return (4.0 * once - twice) / 3.0


NOISE_ENTRIES = [
    *[("sigma_trans_m_per_sqrt_m", i) for i in range(3)],
    *[("sigma_rot_rad_per_sqrt_m", i) for i in range(3)],
    ("sigma_turn_rad_per_sqrt_rad", ()),
    ("sigma_log_scale", ()),
    *[("sigma_bias_trans_m_per_m", i) for i in range(3)],
    *[("sigma_bias_rot_rad_per_m", i) for i in range(3)],
]


@pytest.fixture(scope="module")
def gradient(at_optimum) -> PoseGraph:
    """With respect to everything in the graph at once; each test compares some of its numbers."""
    return value_and_gradient(at_optimum)[1]


def check(graph: PoseGraph, gradient: PoseGraph, where, entry, step: float) -> None:
    def moved(g: PoseGraph, h: float) -> PoseGraph:
        return eqx.tree_at(where, g, where(g).at[entry].add(h))

    expected = central_difference(graph, moved, step)
    assert abs(expected) > 1e-6
    assert_allclose(float(where(gradient)[entry]), expected, rtol=1e-5)


@pytest.mark.parametrize(("name", "entry"), NOISE_ENTRIES)
def test_gradient_in_the_noise(at_optimum, gradient, name, entry):
    def where(g: PoseGraph) -> jax.Array:
        return getattr(g.noise, name)

    check(at_optimum, gradient, where, entry, 0.005 * float(where(at_optimum)[entry]))


@pytest.mark.parametrize("entry", [(0, 0), (3, 1), (6, 2)])
def test_gradient_in_a_surveyed_position(at_optimum, gradient, entry):
    check(at_optimum, gradient, lambda g: g.anchors.measured_m, entry, 1e-3)


@pytest.mark.parametrize("entry", [(1, 2), (5, 0)])
def test_gradient_in_a_lever_arm(at_optimum, gradient, entry):
    check(at_optimum, gradient, lambda g: g.anchors.lever_arm_m, entry, 1e-3)


@pytest.mark.parametrize(("axis", "edge"), [(0, 1), (1, 50), (2, 99)])
def test_gradient_in_the_odometry(at_optimum, gradient, axis, edge):
    check(at_optimum, gradient, lambda g: g.chain.odometry.t[axis], edge, 1e-3)


def test_gradient_from_a_common_start(graph, at_optimum, gradient):
    """Started at the coarse fit, the solve for a gradient goes far enough for every entry to be right."""
    found, again = value_and_gradient(graph)
    assert_allclose(float(found), value(at_optimum), rtol=1e-8)
    by_percent = [
        np.concatenate([np.ravel(getattr(g.noise, name) * getattr(graph.noise, name)) for name, _ in NOISE_ENTRIES])
        for g in (again, gradient)
    ]
    assert_allclose(*by_percent, rtol=1e-5)


def flat(x: Increments) -> np.ndarray:
    """Real edges' six numbers each, then bias and log-scale."""
    glob = x.glob
    tail = np.array([*glob.bias_trans, *glob.bias_rot, glob.log_scale])
    return np.concatenate([np.asarray(increment_rows(x))[:, :N].T.reshape(-1), tail])


def increments(vector: np.ndarray) -> Increments:
    rows = np.zeros((6, PADDED))
    rows[:, :N] = vector[: 6 * N].reshape(N, 6).T
    b = [jnp.asarray(v) for v in vector[6 * N :]]
    return increments_of(jnp.asarray(rows), Globals((b[0], b[1], b[2]), (b[3], b[4], b[5]), b[6]))


@pytest.fixture(scope="module")
def whitened(at_optimum) -> np.ndarray:
    """The dense Jacobian in edge coordinates."""
    return dense_system(at_optimum, N)[1] @ edge_coordinates(N, G)


@pytest.fixture(scope="module")
def unit(whitened) -> np.ndarray:
    """How much each unknown weighs: what brings the Hessian's diagonal near 1."""
    return np.linalg.norm(whitened, axis=0)


@jax.jit
def displaced(graph: PoseGraph, increment: Increments) -> PoseGraph:
    return rebased(graph, poses_at(increment, graph.base), globals_at(increment, graph))


def test_hessian_product(at_optimum, whitened, unit):
    """Differences of the gradient J'r, J by automatic derivatives of the residual function.

    Increments are taken about other poses on either side, which changes the gradient by its own size times the
    increment: nothing, to first order, where it vanishes.
    """
    chain = edge_coordinates(N, G)
    direction = np.random.default_rng(5).standard_normal(6 * N + G) / unit
    step = 1e-3
    sides = [dense_system(displaced(at_optimum, increments(s * step * chain @ direction)), N) for s in (1.0, -1.0)]
    ahead, behind = (chain.T @ (jacobian.T @ residual) / unit for residual, jacobian in sides)
    expected = (ahead - behind) / (2.0 * step)
    found = flat(jax.jit(hessian_product)(increments(direction), at_optimum)) / unit
    assert_allclose(found, expected, rtol=0, atol=1e-7)
    # And the Hessian is not merely Gauss and Newton's.
    gauss_newton = whitened.T @ (whitened @ direction) / unit
    assert np.max(np.abs(found - gauss_newton)) > 1e-3


def test_gauss_newton_solve(at_optimum, whitened, unit):
    force = np.random.default_rng(6).standard_normal(6 * N + G) * unit
    factor, _ = dense_factor(whitened)
    expected = np.linalg.solve(factor, np.linalg.solve(factor.T, force / unit))
    found = flat(jax.jit(lambda g, f: gauss_newton_solve(linearisation(g), f))(at_optimum, increments(force))) * unit
    assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_no_gradient_where_the_frame_is_free(at_optimum):
    """Two positions and no rotation: an error, not a number."""
    a = at_optimum.anchors
    two = eqx.tree_at(
        lambda g: (g.anchors.sqrt_information, g.anchors.sqrt_information_rotation),
        at_optimum,
        (a.sqrt_information.at[2:].set(0.0), jnp.zeros_like(a.sqrt_information_rotation)),
    )
    with pytest.raises(eqx.EquinoxRuntimeError, match="linear solver"):
        value_and_gradient(two)
