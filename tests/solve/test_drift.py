"""The prefix sums of `drift` against every single noise of every edge."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.chain_session import graph_of, session, started_badly
from solve.dense_drift import dense_covariance_between

from jaxgeo.graph.components import ANCHOR, COMPONENTS, N_COMPONENTS
from jaxgeo.graph.pose_graph import Globals, PoseGraph, Terms, chain_noise
from jaxgeo.solve.drift import covariance_between, drift_at, own_covariance
from jaxgeo.solve.linearise import Edges, edges_at

N, PADDED = 120, 128
CORRELATION_M = 9.0
LOG_SCALE = 0.2


@jax.jit
def edges_of(graph: PoseGraph) -> Edges:
    zero = jnp.zeros(3)
    glob = Globals(tuple(zero), tuple(zero), jnp.asarray(LOG_SCALE))
    return edges_at(graph.base, chain_noise(graph.base, glob, graph), glob, jnp.ones(()), graph)


@jax.jit
def found(left, here, right, there, edges: Edges, graph: PoseGraph) -> tuple[jax.Array, jax.Array]:
    at_here, at_there = drift_at(edges, graph, here), drift_at(edges, graph, there)
    length = jnp.asarray(CORRELATION_M)
    return covariance_between(left, at_here, right, at_there, length), own_covariance(left, at_here, length)


@pytest.fixture(scope="module")
def chain() -> tuple[Edges, PoseGraph]:
    """Far from the odometry, so that no Jacobian is near the identity."""
    graph = started_badly(graph_of(session(N), Terms(log_scale=True)), N, 5, 0.4, 0.3, 0.7)
    return edges_of(graph), graph


def random_rows(seed: int, index: np.ndarray, d: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((len(index), d, 6))


# The first pose, the padding, two at one pose, out of order.
HERE = np.array([40, 0, 119, 77, 77, 127, 3])
THERE = np.array([1, 77, 40, 100, 64])


def test_every_component_against_every_single_noise(chain):
    left, right = random_rows(0, HERE, 2), random_rows(1, THERE, 3)
    got, _ = found(left, HERE, right, THERE, *chain)
    expected = dense_covariance_between(left, HERE, right, THERE, *chain, CORRELATION_M)
    for c, name in enumerate(COMPONENTS):
        size = np.abs(expected[c]).max()
        assert (size > 0) == (c != ANCHOR), name
        assert_allclose(got[c], expected[c], rtol=0, atol=1e-11 * size, err_msg=name)


def test_a_pose_with_itself(chain):
    left = random_rows(2, HERE, 3)
    both, own = found(left, HERE, left, HERE, *chain)
    k = len(HERE)
    blocks = np.asarray(both).reshape(N_COMPONENTS, k, 3, k, 3)[:, np.arange(k), :, np.arange(k)]
    expected = np.swapaxes(blocks, 0, 1)
    assert_allclose(own, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    for c, name in enumerate(COMPONENTS):
        assert_allclose(both[c], both[c].T, rtol=0, atol=1e-12 * np.abs(both[c]).max(), err_msg=name)
        eigenvalue = np.linalg.eigvalsh(both[c])
        assert eigenvalue[0] >= -1e-11 * eigenvalue[-1], name


def test_the_first_pose_has_no_drift_but_its_bounded_error(chain):
    first = np.array([0])
    left = np.eye(6)[None]
    _, own = found(left, first, left, first, *chain)
    expected = np.zeros((N_COMPONENTS, 6, 6))
    expected[COMPONENTS.index("bounded_m"), :3, :3] = np.eye(3)
    assert_allclose(own[:, 0], expected, rtol=0, atol=1e-14)
