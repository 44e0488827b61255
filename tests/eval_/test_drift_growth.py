"""Drift of the odometry alone: variances against the estimator's prefix sums, and what the curves are made of."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eval.drift_growth import unit_variances, weighted_quantile
from jaxgeo.data import Trajectory
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import BOUNDED, COMPONENTS, LOG_SCALE, TRANS
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.pose_graph import AnchorRows, PoseGraph, Terms, zero_globals
from jaxgeo.solve.anchor_system import State, chain_linearised
from jaxgeo.solve.drift import Drift, drift_at, own_covariance
from jaxgeo.solve.linearise import hat

START = 17
INDEX = np.array([17, 40, 99, 119])
CORRELATION_M = 5.0


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    rng = np.random.default_rng(0)
    turned = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.05, (120, 3)), axis=0))
    # Small steps of small turns: the estimator measures edges along their twist, this file along the chord.
    position_m = np.cumsum(rng.normal(0.3, 0.5, (120, 3)), axis=0)
    return Trajectory(np.arange(120.0), position_m, turned.as_quat(scalar_first=True))


def by_prefix_sums(trajectory: Trajectory) -> np.ndarray:
    """The same traces from the estimator's own sums, those up to the first pose taken off."""
    chain = chain_of(trajectory)
    n = chain.length_m.shape[0]
    three, square = jnp.zeros((1, 3)), jnp.zeros((1, 3, 3))
    rows = AnchorRows(jnp.array([119]), jnp.zeros(n, int), three, three, square, square, square)
    terms, noise = Terms(False, True, False, "none"), odometry_noise(0.1, 0.1)
    graph = PoseGraph(chain, rows, noise, chain.start, zero_globals(), jnp.asarray(3.0), terms)
    zero = jnp.zeros(n)
    edges = chain_linearised(State(chain.start, jnp.zeros(()), (zero, zero, zero)), graph).edges
    at = drift_at(edges, graph, jnp.asarray(np.append(INDEX, START)))
    first = at.white[:, -1:], at.constant[-1:], at.block[-1:]
    since = Drift(
        at.index[:-1],
        at.white[:, :-1] - first[0],
        at.constant[:-1] - first[1],
        at.block[:-1] - first[2],
        at.distance_m[:-1],
        at.block_length_m,
    )
    position = jnp.stack([c[INDEX] for c in chain.start.t], axis=-1)
    left = jnp.concatenate([jnp.broadcast_to(jnp.eye(3), (len(INDEX), 3, 3)), -hat(position)], axis=-1)
    covariance = own_covariance(left, since, jnp.asarray(CORRELATION_M))
    return np.trace(np.asarray(covariance), axis1=-2, axis2=-1)


def test_variances_are_the_estimators(trajectory):
    _, found = unit_variances(trajectory, START, INDEX, CORRELATION_M)
    expected = by_prefix_sums(trajectory)
    for component, name in enumerate(COMPONENTS):
        if component != BOUNDED:
            np.testing.assert_allclose(found[component], expected[component], rtol=2e-3, err_msg=name)


def test_bounded_error_is_the_difference_of_its_two_ends(trajectory):
    path_m, found = unit_variances(trajectory, START, INDEX, CORRELATION_M)
    ends = path_m[INDEX] - path_m[START]
    # Var(u - v) of two unit variables with correlation exp(-d/l), on three axes.
    np.testing.assert_allclose(found[BOUNDED], 3.0 * (1.0 + 1.0 - 2.0 * np.exp(-ends / CORRELATION_M)))


def test_scale_enters_where_it_should(trajectory):
    """A wrong scale moves a pose by its distance; white noise is by the odometry's own distance."""
    _, once = unit_variances(trajectory, START, INDEX, CORRELATION_M)
    _, twice = unit_variances(trajectory, START, INDEX, CORRELATION_M, scale=2.0)
    np.testing.assert_allclose(twice[LOG_SCALE], 4.0 * once[LOG_SCALE])
    np.testing.assert_allclose(twice[TRANS], once[TRANS])
    away_m = trajectory.position_m[INDEX] - trajectory.position_m[START]
    np.testing.assert_allclose(once[LOG_SCALE], (away_m**2).sum(axis=1))


def test_weighted_quantile_of_equal_weights_is_a_row():
    value = np.array([[3.0, 1.0], [1.0, 3.0], [2.0, 2.0]])
    assert weighted_quantile(value, np.ones(3) / 3.0, 0.5).tolist() == [2.0, 2.0]
    assert weighted_quantile(value, np.array([0.98, 0.01, 0.01]), 0.5).tolist() == [3.0, 1.0]
    assert weighted_quantile(value, np.ones(3) / 3.0, 1.0).tolist() == [3.0, 3.0]
