"""The optimum is GTSAM's, whatever the chain's length, the anchors' kind and the start."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.chain_session import graph_of, session, started_badly
from solve.gtsam_peer import cost_of_values, gtsam_graph, gtsam_solve, gtsam_values
from solve.programs import solve

from jaxgeo.graph.pose_graph import PoseGraph, Terms, chain_noise, cost_at
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
    """Our cost above GTSAM's, relative, both by one cost function and from one start."""
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


# The long chains are as few as show it: each compiles its own program, and GTSAM takes seconds.
CASES = [*[(100, kind) for kind in KINDS], (1829, "six degrees"), (1829, "six degrees, bad data")]


@pytest.mark.parametrize(("n", "kind"), [*CASES, (20_000, "lever arm")])
def test_same_optimum_as_gtsam(n, kind):
    assert abs(excess(graph_of_kind(n, kind), n)) < 1e-8


@pytest.mark.parametrize(("n", "kind"), CASES)
def test_same_optimum_from_a_bad_start(n, kind):
    """Every pose 0.5 m and 0.2 rad off, the map turned by 60 degrees on top: the solver copes without a coarse fit."""
    graph = started_badly(graph_of_kind(n, kind), n, 3, 0.5, 0.2, np.radians(60.0))
    assert abs(excess(graph, n)) < 1e-8
