"""The benchmarks' pieces on small problems: the peer's optimum, the same chain for a seed; no timing is judged."""

import json

from benchmarks.chain import chain_graph
from benchmarks.solver import against_gtsam
from jaxgeo.solve.solver import result_words, solve_graph


def test_a_small_chain_reaches_the_peers_optimum():
    row = against_gtsam(200, 1)
    assert row["relative_cost_difference"] < 1e-8
    assert row["result"] == "converged"
    assert row["gtsam_s"] > 0
    assert row["ours_s"] > 0
    json.dumps(row)


def test_the_chain_is_the_same_for_a_seed():
    graph, again = chain_graph(200, 7), chain_graph(200, 7)
    assert (graph.chain.start.t[0] == again.chain.start.t[0]).all()
    assert result_words(solve_graph(graph).result) == "converged"
