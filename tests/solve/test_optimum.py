"""The optimum is GTSAM's, whatever the chain's length, the anchors' kind and the start."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from chain_session import graph_of, session, started_badly
from gtsam_peer import cost_of_values, gtsam_graph, gtsam_solve, gtsam_values
from numpy.testing import assert_allclose
from programs import fold, solve

from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.pose_graph import PoseGraph, Terms, chain_noise, cost_at
from jaxgeo.solve.fold import FoldOptions
from jaxgeo.solve.solver import result_words

K = 7
KINDS = {
    "position": {},
    "lever arm": {"lever_m": 1.0},
    "six degrees": {"lever_m": 1.0, "sigma_rot_rad": 0.02},
    # Errors of three times what the noise says: Gauss-Newton is farther from Newton.
    "six degrees, bad data": {"lever_m": 1.0, "sigma_rot_rad": 0.02, "error_size": 3.0},
}


def graph_of_kind(n: int, kind: str) -> PoseGraph:
    return graph_of(session(n, K, **KINDS[kind]), Terms(rotation="sigma_rot_rad" in KINDS[kind]))


def excess(graph: PoseGraph, n: int) -> float:
    """Our cost above GTSAM's, relative, both at the same cost function; GTSAM begins at the graph's good start."""
    found = solve(graph)
    assert result_words(found.result) == "converged"
    ours = float(cost_at(found.poses, found.glob, chain_noise(found.poses, found.glob, graph), graph))
    assert_allclose(float(found.cost), ours, rtol=1e-12)
    factors = gtsam_graph(graph, n, K)
    theirs = gtsam_solve(factors, gtsam_values(graph, n))
    cost = cost_of_values(theirs, graph, n)
    # The two graphs are one: GTSAM's own cost of its poses is ours.
    assert_allclose(factors.error(theirs), cost, rtol=1e-10)
    return (ours - cost) / cost


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [100, 1829])
def test_same_optimum_as_gtsam(n, kind):
    graph = graph_of_kind(n, kind)
    assert abs(excess(graph, n)) < 1e-8


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [100, 1829])
def test_same_optimum_from_a_bad_start(n, kind):
    """Every pose 0.5 m and 0.2 rad off, the map turned by 60 degrees on top: the raw solver copes without a coarse fit."""
    graph = started_badly(graph_of_kind(n, kind), n, 3, 0.5, 0.2, np.radians(60.0))
    assert abs(excess(graph, n)) < 1e-8


def test_same_optimum_on_a_long_chain():
    assert abs(excess(graph_of_kind(20_000, "lever arm"), 20_000)) < 1e-8


def test_a_turned_and_moved_map_ends_where_the_straight_one_does():
    """Half a turn is beyond the raw solver; a fold begins with the coarse fit, and does not see it."""
    made = session(100, K, lever_m=1.0)
    turned = started_badly(graph_of(made), 100, 0, 0.0, 0.0, np.pi)
    odometry = made.trajectory
    quat = np.stack([np.asarray(c)[:100] for c in turned.base.quat], axis=1)
    position = np.stack([np.asarray(c)[:100] for c in turned.base.t], axis=1) + 1000.0
    points = []
    for trajectory in (odometry, dataclasses.replace(odometry, position_m=position, quat_wxyz=quat)):
        chain = chain_of(trajectory)
        table = anchor_table(made.anchors, chain)
        found, _ = fold(chain, table, made.noise, table.real, jnp.asarray(3.0), options=FoldOptions())
        assert result_words(found.solution.result) == "converged"
        points.append(np.asarray(found.point_m)[:K])
    assert_allclose(points[0], points[1], rtol=0, atol=1e-8)
