"""Nothing larger than poses x anchors is built, by the solve, its gradient, or the covariances."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jax.extend.core import ClosedJaxpr, Jaxpr
from solve.chain_session import graph_of, session

from jaxgeo.graph.pose_graph import PoseGraph, Terms
from jaxgeo.solve.posterior import all_pose_covariances, posterior
from jaxgeo.solve.solver import solve_graph, solve_graph_differentiably

N, K, D = 2048, 8, 6
# An anchor's rows against a pose's increment; or the sums along the chain.
LARGEST = N * max(K * D * 6, 64)


def shapes(jaxpr: Jaxpr) -> set[tuple[int, ...]]:
    """Of every array in a program, programs within it included."""
    found: set[tuple[int, ...]] = set()
    for equation in jaxpr.eqns:
        found |= {tuple(v.aval.shape) for v in equation.outvars}
        for parameter in jax.tree.leaves(
            list(equation.params.values()), is_leaf=lambda x: isinstance(x, Jaxpr | ClosedJaxpr)
        ):
            if isinstance(parameter, ClosedJaxpr):
                found |= shapes(parameter.jaxpr)
            elif isinstance(parameter, Jaxpr):
                found |= shapes(parameter)
    return found


def solution(graph: PoseGraph) -> jax.Array:
    return solve_graph(graph).poses.t[0]


def gradient(graph: PoseGraph) -> PoseGraph:
    return eqx.filter_grad(lambda g: jnp.sum(solve_graph_differentiably(g).poses.t[0][100:110]))(graph)


def covariances(graph: PoseGraph) -> jax.Array:
    return all_pose_covariances(posterior(graph, graph.base, graph.base_globals))


@pytest.mark.parametrize("program", [solution, gradient, covariances])
def test_largest_array(program):
    graph = graph_of(session(N, K, sigma_rot_rad=0.02), Terms(rotation=True))
    dynamic, static = eqx.partition(graph, eqx.is_array)
    traced = jax.make_jaxpr(lambda g: eqx.filter(program(eqx.combine(g, static)), eqx.is_array))(dynamic)
    found = shapes(traced.jaxpr)
    # The chain itself was seen: the walk through the program did not stop at its shell.
    assert (N,) in found
    assert len(found) > 20
    size = {shape: int(jnp.prod(jnp.asarray(shape, dtype=float))) if shape else 1 for shape in found}
    assert max(size.values()) <= LARGEST, max(size, key=lambda s: size[s])
    assert not any(shape.count(N) > 1 for shape in found)
