"""Implicit gradients that never build a matrix over the poses.

`optimistix.ImplicitAdjoint` needs the solution of one linear system with the true Hessian of the cost. Conjugate
gradients solve it on Hessian-vector products, preconditioned by the exact inverse of the Gauss-Newton Hessian, which in
measurement space costs no more than a step of the solver. Gauss-Newton is nearly the Hessian here: a handful of
iterations.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree

from jaxgeo.graph import soa
from jaxgeo.graph.chain import Poses
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.pose_graph import Globals, Increments, PoseGraph, chain_noise, increment_rows, increments_of
from jaxgeo.solve.hessian import hessian_at
from jaxgeo.solve.linearise import (
    Edges,
    SmallSystem,
    edges_at,
    force_on_edges,
    globals_of,
    globals_vector,
    increments_from,
    small_system,
    solve_small,
)
from jaxgeo.solve.prefix import prefix_sum, prefix_sum_at, suffix_sum


class Linearisation(eqx.Module):
    """Undamped Gauss-Newton Hessian of a graph at its base."""

    edges: Edges
    system: SmallSystem
    influence: Float[Array, "k 6 g"]
    graph: PoseGraph


def linearisation(graph: PoseGraph) -> Linearisation:
    one = jnp.ones(())
    eps = chain_noise(graph.base, graph.base_globals, graph)
    edges = edges_at(graph.base, eps, graph.base_globals, one, graph)
    edges = eqx.tree_at(lambda e: (e.a, e.b), edges, compute_once(graph.loss_width > 0, (edges.a, edges.b)))
    system, _, influence = small_system(graph.base, eps, edges, graph, one)
    return Linearisation(edges, system, influence, graph)


def gauss_newton_solve(lin: Linearisation, rhs: Increments) -> Increments:
    """Solve `J'J x = rhs` at the base, in edge coordinates: forces on edges and globals in, their increments out.

    In these coordinates the chain's part of J'J is block diagonal; the anchors add a low-rank term, so that one dense
    system of the anchors' size finishes the work.
    """
    edges, system, graph = lin.edges, lin.system, lin.graph
    always = graph.loss_width > 0
    force = (rhs.trans, rhs.rot)
    on_noise = compute_once(always, edges.backward(*force))
    on_globals = globals_vector(rhs.glob, graph) + _force_on_globals(on_noise, force[0], edges, graph)
    free = (soa.mul(edges.variance_trans, on_noise[0]), soa.mul(edges.variance_rot, on_noise[1]))
    free_globals = system.globals_variance * on_globals
    free_rows = jnp.stack([c for part in edges.forward(*free) for c in part])
    at = prefix_sum_at(free_rows, graph.anchors.pose_index).T
    c = jnp.einsum("kda,ka->kd", system.jacobian, at).reshape(-1) + system.globals_jacobian @ free_globals
    multiplier, delta_0 = solve_small(system, c, jnp.stack([row[0] for row in (*rhs.trans, *rhs.rot)]))
    shape = system.jacobian.shape
    pull = edges.backward(
        *force_on_edges(jnp.einsum("kda,kd->ka", system.jacobian, multiplier.reshape(shape[:2])), graph)
    )
    glob = globals_of(free_globals - system.globals_variance * (system.globals_jacobian.T @ multiplier), graph)
    trans = soa.sub(free[0], soa.mul(edges.variance_trans, pull[0]))
    rot = soa.sub(free[1], soa.mul(edges.variance_rot, pull[1]))
    if graph.terms.bias:
        trans = soa.add(trans, soa.scale(edges.length_m, glob.bias_trans))
        rot = soa.add(rot, soa.scale(edges.length_m, glob.bias_rot))
    noise = compute_once(always, (trans, rot))
    return increments_of(increments_from(edges, delta_0, noise, glob.log_scale), glob)


def _force_on_globals(
    on_noise: tuple[tuple[Array, ...], tuple[Array, ...]],
    behind_trans: tuple[Array, ...],
    edges: Edges,
    graph: PoseGraph,
) -> Float[Array, "g"]:
    parts: list[Array] = []
    if graph.terms.bias:
        parts += [jnp.sum(edges.length_m * f) for f in (*on_noise[0], *on_noise[1])]
    if graph.terms.log_scale:
        parts.append(sum(jnp.sum(f * g) for f, g in zip(behind_trans, edges.scale_column, strict=True)))  # type: ignore[arg-type]
    return jnp.stack(parts) if parts else jnp.zeros((0,))


def _dot(x: PyTree, y: PyTree) -> Array:
    return sum((jnp.sum(a * b) for a, b in zip(jax.tree.leaves(x), jax.tree.leaves(y), strict=True)), jnp.zeros(()))


def _axpy(a: Array, x: PyTree, y: PyTree) -> PyTree:
    return jax.tree.map(lambda p, q: a * p + q, x, y)


class ChainCG(lx.AbstractLinearSolver):
    """Conjugate gradients on the Hessian, preconditioned by `gauss_newton_solve`, both at the base: the optimum.

    The operator that optimistix hands over is this same Hessian by automatic differentiation, ten times as dear.

    Where it does not reach `rtol` within `max_steps` (an indefinite or singular Hessian) the solution is NaN, on which
    lineax raises: never a wrong gradient, but one such lane takes a whole `vmap` with it. Mask those of a free gauge.
    """

    graph: PoseGraph
    rtol: float = 1e-7
    max_steps: int = 50

    def init(self, operator: lx.AbstractLinearOperator, options: dict) -> Any:
        return operator

    def compute(self, state: Any, vector: PyTree, options: dict) -> tuple[PyTree, lx.RESULTS, dict]:
        lin = linearisation(self.graph)
        product = hessian_at(self.graph)
        always = self.graph.loss_width > 0
        vector = compute_once(always, vector)
        on_edges = compute_once(always, increments_of(suffix_sum(increment_rows(vector)), vector.glob))
        preconditioned = gauss_newton_solve(lin, on_edges)
        zero = jax.tree.map(jnp.zeros_like, vector)
        first = _dot(on_edges, preconditioned)

        def unfinished(carry: tuple) -> Bool[Array, ""]:
            *_, rz, k = carry
            return (jnp.abs(rz) > self.rtol**2 * first) & (k < self.max_steps)

        def iterate(carry: tuple) -> tuple:
            x, r, p, rz, k = carry
            hp = product(p)
            alpha = rz / _dot(p, hp)
            x, r = _axpy(alpha, p, x), _axpy(-alpha, hp, r)
            z = gauss_newton_solve(lin, r)
            rz_new = _dot(r, z)
            return x, r, _axpy(rz_new / rz, p, z), rz_new, k + 1

        start = (zero, on_edges, preconditioned, first, jnp.array(0))
        x, _, _, rz, k = jax.lax.while_loop(unfinished, iterate, start)
        good = jnp.abs(rz) <= self.rtol**2 * first
        x = increments_of(prefix_sum(increment_rows(x)), x.glob)
        return (
            compute_once(always, jax.tree.map(lambda v: jnp.where(good, v, jnp.nan), x)),
            lx.RESULTS.successful,
            {"num_steps": k},
        )

    def transpose(self, state: Any, options: dict) -> tuple[Any, dict]:
        return state, options  # a Hessian is symmetric

    def conj(self, state: Any, options: dict) -> tuple[Any, dict]:
        return state, options  # and real

    def assume_full_rank(self) -> bool:
        return True


class AtOptimum(optx.AbstractLeastSquaresSolver):
    """Takes no step: `y0` is the optimum already, found without derivatives; only the adjoint is wanted."""

    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Array] = optx.max_norm

    def init(
        self, fn: Any, y: PyTree, args: Any, options: dict, f_struct: Any, aux_struct: Any, tags: frozenset
    ) -> Any:
        return None

    def step(self, fn: Any, y: PyTree, args: Any, options: dict, state: Any, tags: frozenset) -> tuple:
        return y, state, None

    def terminate(
        self, fn: Any, y: PyTree, args: Any, options: dict, state: Any, tags: frozenset
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        return jnp.array(True), optx.RESULTS.successful

    def postprocess(
        self, fn: Any, y: PyTree, aux: Any, args: Any, options: dict, state: Any, tags: frozenset, result: optx.RESULTS
    ) -> tuple[PyTree, Any, dict]:
        return y, aux, {}


def rebased(graph: PoseGraph, poses: Poses, glob: Globals) -> PoseGraph:
    """The same graph, its increments taken about other poses and globals."""
    return eqx.tree_at(lambda g: (g.base, g.base_globals), graph, (poses, glob))
