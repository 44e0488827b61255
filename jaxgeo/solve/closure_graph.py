"""Solve a graph of poses and relative poses, thousands of closures among them, false ones too."""

import dataclasses
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from jaxgeo.data.relative_poses import RelativePoses
from jaxgeo.errors import ConfigError
from jaxgeo.geometry.robust import check_robust
from jaxgeo.graph.bucket import pose_bucket
from jaxgeo.graph.chain import Poses, poses_of
from jaxgeo.graph.closure_graph import (
    ClosureEdges,
    ClosureGraph,
    closure_edges,
    closure_noise,
    closure_residuals,
    squared_norms,
)
from jaxgeo.graph.closure_structure import odometry_edges, structure_of
from jaxgeo.precision import assert_float64
from jaxgeo.solve.closure_gnc import FACTOR, first_control, truncated_weights
from jaxgeo.solve.closure_inputs import check_pieces, checked_graph, information_roots
from jaxgeo.solve.closure_linearise import edge_weights
from jaxgeo.solve.closure_solver import LOOSEST, ClosureLM, ClosureState
from jaxgeo.solve.closure_start import chordal_start
from jaxgeo.solve.solver import result_words

Loss = Literal["none", "cauchy", "geman_mcclure", "gnc"]
Start = Literal["given", "chordal", "best"]

# Six whitened numbers of a true closure have a length above 4.7 once in a thousand (chi-squared, six degrees).
USUAL_WIDTH = 4.7
# Between two changes of the weights. Less (four steps, a hundredth) lost one true closure in eight on a hard graph.
_BETWEEN = ClosureLM(rtol=1e-3, max_steps=10, tightest=LOOSEST)
# Steps of graduated non-convexity after which it is not going to settle.
_MOST_STEPS = 1000
# From this control parameter on, the stand-in differs from truncated least squares by a tenth of the width.
_CLOSEST = 10.0


@dataclasses.dataclass(frozen=True)
class ClosureSettings:
    """How a graph is solved.

    Attributes:
        loss: on all edges but the odometry: `none`; `cauchy`, `geman_mcclure` (reweighted from the start, for a good
            start); `gnc` (truncated least squares by graduated non-convexity: rejects false closures).
        loss_width: length of an edge's whitened residual (six numbers) from which the loss doubts it.
        max_steps: steps of the solver, rejected ones included; with `gnc` in every stage.
        start: the `given` poses, the `chordal` ones, which depend on the edges alone, or the `best` (the cheaper).
    """

    loss: Loss = "none"
    loss_width: float = USUAL_WIDTH
    max_steps: int = 100
    start: Start = "best"


@dataclasses.dataclass(frozen=True)
class ClosureSolution:
    """A solved graph of n poses and m edges.

    Attributes:
        position_m: (n, 3); the first pose is the given one.
        quat_wxyz: (n, 4).
        cost: half the sum of squared whitened residuals of the edges, each times its `weight`.
        total_cost: the same with the robust loss instead of the weight (`gnc`: an edge costs half the width squared at
            most).
        start_cost: half the sum of squared residuals at the start chosen, nothing doubted.
        squared_residual: (m,) of every edge, whitened, at the solution.
        weight: (m,) 1 for an edge that counts fully, 0 for a rejected one.
        start: `given` or `chordal`.
        result: `converged`, or what went wrong: then do not use the poses.
        steps, cg_steps: of the solver, and of conjugate gradients in all of them.
    """

    position_m: Float[np.ndarray, "n 3"]
    quat_wxyz: Float[np.ndarray, "n 4"]
    cost: float
    total_cost: float
    start_cost: float
    squared_residual: Float[np.ndarray, "m"]
    weight: Float[np.ndarray, "m"]
    start: str
    result: str
    steps: int
    cg_steps: int

    @property
    def converged(self) -> bool:
        return self.result == "converged"


class _Solved(eqx.Module):
    """What one call of the compiled solver gives back."""

    poses: Poses
    squared: Array
    weight: Array
    cost: Array
    steps: Array
    cg_steps: Array
    result: optx.RESULTS


def solve_closure_graph(
    position_m: Float[np.ndarray, "n 3"],
    quat_wxyz: Float[np.ndarray, "n 4"],
    edges: RelativePoses,
    settings: ClosureSettings | None = None,
) -> ClosureSolution:
    """Poses that fit the relative poses best; the first one is held where it is given.

    Edges between successive poses are odometry and are never doubted. A solve that did not converge is returned with
    its `result`; gate on it.

    Args:
        position_m, quat_wxyz: start values, any local frame.
        edges: all of them, odometry and closures, several sessions alike.
        settings: default: no robust loss, the better of the given and the chordal start.

    Raises:
        GraphError: the graph is unusable (see `checked_graph`), or in several pieces.
        ConfigError: settings that are unknown.
        UndeterminedError: without the rejected edges the graph falls into pieces.
    """
    assert_float64()
    settings = settings or ClosureSettings()
    _check_settings(settings)
    quat_wxyz, edges = checked_graph(position_m, quat_wxyz, edges)
    origin = position_m[0]  # large coordinates would cost digits
    graph = graph_of(position_m - origin, quat_wxyz, edges, settings)
    graph, start, start_cost = _started(graph, position_m - origin, quat_wxyz, edges, settings)
    found = (
        _graduated(graph, settings)
        if settings.loss == "gnc"
        else _solve(graph, ClosureLM(max_steps=settings.max_steps))
    )
    n, m = len(position_m), len(edges)
    squared, weight = np.asarray(found.squared)[:m], np.asarray(found.weight)[:m]
    if settings.loss == "gnc":
        check_pieces(n, edges, weight)
    cost, total = 0.5 * float(np.sum(weight * squared)), float(found.cost)
    if settings.loss == "gnc":
        doubted = np.asarray(graph.doubted)[:m] > 0
        total = 0.5 * float(np.sum(np.where(doubted, np.minimum(squared, settings.loss_width**2), squared)))
    return ClosureSolution(
        np.stack([np.asarray(c)[:n] for c in found.poses.t], axis=1) + origin,
        np.stack([np.asarray(c)[:n] for c in found.poses.quat], axis=1),
        cost,
        total,
        start_cost,
        squared,
        weight,
        start,
        result_words(found.result),
        int(found.steps),
        int(found.cg_steps),
    )


def _check_settings(settings: ClosureSettings) -> None:
    for name, value, choices in (("loss", settings.loss, get_args(Loss)), ("start", settings.start, get_args(Start))):
        if value not in choices:
            raise ConfigError(f"{name} {value!r} is unknown; expected one of {', '.join(choices)}.")
    check_robust("none", settings.loss_width)
    if settings.max_steps < 1:
        raise ConfigError(f"max_steps {settings.max_steps} is below 1.")


def graph_of(
    position_m: Float[np.ndarray, "n 3"],
    quat_wxyz: Float[np.ndarray, "n 4"],
    edges: RelativePoses,
    settings: ClosureSettings,
) -> ClosureGraph:
    """The graph that the solver sees, of checked input."""
    n, m = len(position_m), len(edges)
    root, definite = information_roots(edges)
    padded = pose_bucket(m)
    base = poses_of(position_m, quat_wxyz, pose_bucket(n))
    rows = closure_edges(edges, root, definite & odometry_edges(edges.first, edges.second))
    doubted = ~odometry_edges(edges.first, edges.second)
    strength = np.ones(m)
    if settings.loss != "none":
        squared = np.asarray(_squared(base, rows))[:m]
        usual = max(float(np.median(squared[doubted])) if doubted.any() else 0.0, settings.loss_width**2)
        strength = np.where(doubted, 1.0 / (1.0 + squared / usual) ** 2, 1.0)
    return ClosureGraph(
        base,
        rows,
        structure_of(n, edges.first, edges.second, definite, strength),
        _grown(np.ones(m), padded),
        _grown(doubted.astype(float), padded),
        jnp.asarray(float(settings.loss_width)),
        "none" if settings.loss == "gnc" else settings.loss,
    )


def _grown(values: Float[np.ndarray, "m"], padded: int) -> Float[Array, "p"]:
    return jnp.asarray(np.pad(values, (0, padded - len(values))))


def _started(
    graph: ClosureGraph,
    position_m: Float[np.ndarray, "n 3"],
    quat_wxyz: Float[np.ndarray, "n 4"],
    edges: RelativePoses,
    settings: ClosureSettings,
) -> tuple[ClosureGraph, str, float]:
    """The graph based on the start asked for, which one that was, and its cost (nothing doubted)."""
    found = []
    if settings.start != "chordal":
        found.append(("given", graph))
    if settings.start != "given":
        p, q = chordal_start(position_m, quat_wxyz, edges)
        found.append(("chordal", eqx.tree_at(lambda g: g.base, graph, poses_of(p, q, pose_bucket(len(p))))))
    squared = [np.asarray(_squared(g.base, g.edges)) for _, g in found]
    if settings.loss == "none":
        cost = [0.5 * float(s.sum()) for s in squared]
    else:
        shortened = np.where(np.asarray(graph.doubted) > 0, settings.loss_width**2, np.inf)
        cost = [0.5 * float(np.minimum(s, shortened).sum()) for s in squared]
    best = int(np.argmin(cost))
    return found[best][1], found[best][0], 0.5 * float(squared[best].sum())


@jax.jit
def _squared(poses: Poses, edges: ClosureEdges) -> Float[Array, "m"]:
    return squared_norms(closure_noise(poses, edges), edges)


def _solve(graph: ClosureGraph, solver: ClosureLM) -> _Solved:
    return _compiled_solve(graph, jax.tree.map(jnp.asarray, solver))


@jax.jit
def _compiled_solve(graph: ClosureGraph, solver: ClosureLM) -> _Solved:
    zero = jnp.zeros_like(graph.base.t[0])
    y = ((zero, zero, zero), (zero, zero, zero))
    found = optx.least_squares(closure_residuals, solver, y, graph, max_steps=None, throw=False)
    # The state's poses are those of `found.value`, without the way through logarithm and exponential.
    state: ClosureState = found.state
    squared = squared_norms(state.noise, graph.edges)
    weight = edge_weights(squared, graph)
    return _Solved(state.poses, squared, weight, state.cost, state.steps, state.cg_steps, found.result)


def _graduated(graph: ClosureGraph, settings: ClosureSettings) -> _Solved:
    """Truncated least squares: through its stand-ins first, then itself until no edge changes sides."""
    to_the_end = ClosureLM(max_steps=settings.max_steps)
    doubted = np.asarray(graph.doubted) > 0
    weight = np.asarray(graph.weight)
    squared = np.asarray(_squared(graph.base, graph.edges))
    control = first_control(squared[doubted & (weight > 0)], settings.loss_width)
    steps = cg_steps = 0
    while True:
        new = np.where(doubted, truncated_weights(squared, settings.loss_width, control), weight)
        settled = control == np.inf and bool(np.array_equal(new, weight))
        weight = new
        graph = eqx.tree_at(lambda g: g.weight, graph, jnp.asarray(weight))
        found = _solve(graph, to_the_end if settled else _BETWEEN)
        steps, cg_steps = steps + int(found.steps), cg_steps + int(found.cg_steps)
        if settled or steps >= _MOST_STEPS:
            return eqx.tree_at(lambda f: (f.steps, f.cg_steps), found, (jnp.asarray(steps), jnp.asarray(cg_steps)))
        graph = eqx.tree_at(lambda g: g.base, graph, found.poses)
        squared = np.asarray(found.squared)
        control = control * FACTOR if control < _CLOSEST else np.inf
