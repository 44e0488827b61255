"""How the solver goes: monotonically, past wrong anchors, and with a word for every end."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from solve.chain_session import graph_of, real_poses, session, started_badly
from solve.programs import solve

from jaxgeo.graph.pose_graph import PoseGraph, Terms, zero_increments
from jaxgeo.solve.measurement_space import State
from jaxgeo.solve.solver import MAX_STEPS, SOLVER, result_words, succeeded

N, K = 100, 7
CAUCHY = Terms(loss="cauchy")


@jax.jit
def first(graph: PoseGraph) -> State:
    return SOLVER.init(None, zero_increments(graph), graph, {}, None, None, frozenset())


@jax.jit
def following(state: State, graph: PoseGraph) -> State:
    return SOLVER.step(None, zero_increments(graph), graph, {}, state, frozenset())[1]


@pytest.fixture(scope="module")
def with_a_wrong_anchor() -> PoseGraph:
    made = session(N, K, lever_m=1.0)
    surveyed = made.anchors.surveyed_enh_m.copy()
    surveyed[3] += [12.0, -16.0, 0.0]
    return graph_of(
        dataclasses.replace(made, anchors=dataclasses.replace(made.anchors, surveyed_enh_m=surveyed)), CAUCHY
    )


def test_cauchy_gives_way_to_one_wrong_anchor(with_a_wrong_anchor):
    a = with_a_wrong_anchor.anchors
    left_out = eqx.tree_at(lambda g: g.anchors.sqrt_information, with_a_wrong_anchor, a.sqrt_information.at[3].set(0.0))
    # So wide that it does nothing: plain least squares are dragged away.
    wide = eqx.tree_at(lambda g: g.loss_width, with_a_wrong_anchor, jnp.asarray(1e6))
    expected, robust, dragged = (solve(g) for g in (left_out, with_a_wrong_anchor, wide))
    assert all(result_words(s.result) == "converged" for s in (expected, robust))
    where = [real_poses(s.poses, N).translation for s in (expected, robust, dragged)]
    off = [np.linalg.norm(w - where[0], axis=1).max() for w in where[1:]]
    assert off[0] < 0.02
    assert off[1] > 2.0
    # Which is so far off every noise that the solver creeps; it says so.
    assert dragged.result == optx.RESULTS.nonlinear_max_steps_reached
    assert result_words(dragged.result) == "too many steps"
    assert int(dragged.steps) == MAX_STEPS


def test_cost_never_rises(with_a_wrong_anchor):
    for seed in range(3):
        graph = started_badly(with_a_wrong_anchor, N, seed, 2.0, 0.5, 2.0)
        state = first(graph)
        costs = [float(state.cost)]
        damped = False
        for _ in range(60):
            state = following(state, graph)
            costs.append(float(state.cost))
            damped |= bool(state.damping > 0)
            if bool(state.converged):
                break
        assert bool(state.converged)
        assert np.all(np.diff(costs) <= 0.0)
        assert damped, "no trial was ever rejected: a start that tests nothing"


def test_a_start_that_is_not_a_number_diverges():
    graph = graph_of(session(N, K))
    broken = eqx.tree_at(lambda g: g.anchors.measured_m, graph, graph.anchors.measured_m.at[2, 1].set(jnp.nan))
    found = solve(broken)
    assert not bool(succeeded(found.result))
    assert result_words(found.result) != "converged"


def test_nothing_wrong_converges_at_once():
    """At a cost of rounding errors alone, decreases are noise."""
    for seed in range(4):
        graph = graph_of(session(N, K, seed, error_size=0.0))
        for start in (graph, started_badly(graph, N, seed, 0.5, 0.2, 1.0)):
            found = solve(start)
            assert result_words(found.result) == "converged"
            assert float(found.cost) < 1e-18
            assert int(found.steps) < 10
