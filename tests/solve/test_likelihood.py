"""The restricted likelihood against the dense normal equations of the whole graph."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.chain_session import graph_of
from solve.dense_oracle import dense_factor, dense_system, edge_coordinates
from solve.programs import EVERYTHING, optimum, session_of_everything

from jaxgeo.graph.noise import OdometryNoise, edge_variances
from jaxgeo.graph.pose_graph import PoseGraph
from jaxgeo.solve.likelihood import negative_log_likelihood
from jaxgeo.solve.linearise import globals_variance

N, G = 100, 7


@jax.jit
@jax.value_and_grad
def value_and_gradient(noise: OdometryNoise, graph: PoseGraph) -> jax.Array:
    """Linearised at the graph's base, whatever the noise."""
    return negative_log_likelihood(with_noise(graph, noise), graph.base, graph.base_globals)


def with_noise(graph: PoseGraph, noise: OdometryNoise) -> PoseGraph:
    return eqx.tree_at(lambda g: g.noise, graph, noise)


@pytest.fixture(scope="module")
def graph() -> PoseGraph:
    return optimum(graph_of(session_of_everything(N), EVERYTHING))


def dense(graph: PoseGraph) -> float:
    """All unknowns integrated out: the least `|r + J x|^2`, log det J'J, and log det of the noise that whitened it."""
    residual, jacobian = dense_system(graph, N)
    # The change to edge coordinates has determinant 1.
    jacobian = jacobian @ edge_coordinates(N, G)
    factor, size = dense_factor(jacobian)
    explained = np.linalg.solve(factor.T, jacobian.T @ residual / size)
    trans, rot = edge_variances(graph.noise, graph.chain.length_m, graph.chain.turn_rad)
    log_det_noise = sum(float(np.log(np.asarray(v)[1:N]).sum()) for v in (*trans, *rot))
    log_det_noise += float(np.log(np.asarray(globals_variance(graph))).sum())
    log_det = 2.0 * np.log(np.diagonal(factor)).sum() + 2.0 * np.log(size).sum()
    return 0.5 * (residual @ residual - explained @ explained + log_det + log_det_noise)


def changed(noise: OdometryNoise, seed: int) -> OdometryNoise:
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda s: s * jnp.asarray(np.exp(rng.normal(0.0, 0.7, s.shape))), noise)


def test_differences_between_noise_values(graph):
    base = float(value_and_gradient(graph.noise, graph)[0]), dense(graph)
    for seed in range(5):
        other = with_noise(graph, changed(graph.noise, seed))
        found = float(value_and_gradient(other.noise, graph)[0]) - base[0]
        assert abs(found) > 0.1
        assert_allclose(found, dense(other) - base[1], rtol=0, atol=1e-6)


def test_gradient(graph):
    noise = changed(graph.noise, 1)
    _, gradient = value_and_gradient(noise, graph)
    leaves, tree = jax.tree.flatten(noise)
    for i, slope in enumerate(jax.tree.leaves(gradient)):
        for entry in np.ndindex(slope.shape):
            step = 1e-4 * float(leaves[i][entry])
            once, twice = (_difference(graph, tree, leaves, i, entry, h) for h in (step, 2.0 * step))
            assert_allclose(float(slope[entry]), (4.0 * once - twice) / 3.0, rtol=1e-5, atol=1e-6)


def _difference(graph, tree, leaves, i, entry, h) -> float:
    values = []
    for sign in (1.0, -1.0):
        moved = list(leaves)
        moved[i] = leaves[i].at[entry].add(sign * h)
        values.append(float(value_and_gradient(jax.tree.unflatten(tree, moved), graph)[0]))
    return (values[0] - values[1]) / (2.0 * h)


def test_a_held_out_anchor_contributes_nothing(graph):
    """Zero information: its coordinates do not matter, to the last bit, nor is it as if it were known badly."""

    def without(g: PoseGraph, moved_m: float) -> PoseGraph:
        a = g.anchors
        new = eqx.tree_at(
            lambda q: (q.sqrt_information, q.sqrt_information_rotation, q.measured_m),
            a,
            (
                a.sqrt_information.at[2].set(0.0),
                a.sqrt_information_rotation.at[2].set(0.0),
                a.measured_m.at[2].add(moved_m),
            ),
        )
        return eqx.tree_at(lambda q: q.anchors, g, new)

    here, there = (value_and_gradient(graph.noise, without(graph, m)) for m in (0.0, 100.0))
    for a, b in zip(jax.tree.leaves(here), jax.tree.leaves(there), strict=True):
        assert np.array_equal(a, b)
    other = with_noise(without(graph, 0.0), changed(graph.noise, 2))
    found = float(value_and_gradient(other.noise, other)[0]) - float(here[0])
    assert_allclose(found, dense(other) - dense(without(graph, 0.0)), rtol=0, atol=1e-6)
