"""A large graph linearised: every edge's weight and force, its stretches condensed into one edge each.

With `d = y_second - y_first` an edge costs `d' W d / 2 - f' d` in world-frame increments, where

    G = Ad(T_second) J_r(r),   W = G^-T Omega G^-1,   f = -G^-T Omega r

A stretch of edges k between two joints costs, its inner poses being where they cost least,

    (D - u)' C^-1 (D - u) / 2,   C = sum_k W_k^-1,   u = sum_k W_k^-1 f_k = -sum_k Ad(T_k) r_k

in the difference D of its ends: covariances and drifts add up along a chain, as everywhere in `solve.linearise`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.geometry.robust import robust_weight
from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.chain import Poses
from jaxgeo.graph.closure_graph import ClosureGraph, squared_norms
from jaxgeo.graph.closure_structure import Stretches
from jaxgeo.graph.compute_once import compute_once
from jaxgeo.graph.soa import Mat3, Vec3
from jaxgeo.solve.prefix import prefix_sum


class Condensed(eqx.Module):
    """The damped problem of the joints.

    Attributes:
        weight: (e, 6, 6) of every tie between joints.
        force: (e, 6) on its second joint; the opposite on its first.
        inner: what brings the poses on stretches back.
        settled: decrease of the cost from inner poses alone, the joints held.
    """

    weight: Float[Array, "e 6 6"]
    force: Float[Array, "e 6"]
    inner: "Inner | None"
    settled: Float[Array, ""]


class Inner(eqx.Module):
    """Stretch edges: covariance and drift of each, along its stretch, and their sums' inverse and total."""

    covariance: Float[Array, "s 6 6"]
    drift: Float[Array, "s 6"]
    stretch_weight: Float[Array, "q 6 6"]
    stretch_drift: Float[Array, "q 6"]


def condensed(poses: Poses, noise: tuple[Vec3, Vec3], damping: Array, graph: ClosureGraph) -> Condensed:
    """The problem linearised at poses and their edge noise; tree edges made `1 + damping` times as stiff."""
    edges, structure = graph.edges, graph.structure
    rotation, translation = _at_second(poses, graph)
    always = graph.loss_width > 0
    jac, coupling = compute_once(always, se3_soa.right_jacobian(*noise))
    a = soa.matmul(rotation, jac)
    b = soa.mat_add(soa.matmul(rotation, coupling), soa.hat_matmul(translation, a))
    a, b = compute_once(always, (a, b))
    squared = squared_norms(noise, edges)
    strength = edge_weights(squared, graph)
    stiff = 1.0 + damping * structure.tree
    weight, force = _weights(a, b, edges.information, noise, always)
    weight = weight * (jnp.maximum(strength, _TRACE) * stiff)[:, None, None]
    force = force * strength[:, None]
    direct = structure.direct_edge
    weight, force = (v.at[direct].get(mode="fill", fill_value=0.0) for v in (weight, force))
    if structure.stretches is None:
        return Condensed(weight, force, None, jnp.zeros(()))
    inner = _inner(a, b, rotation, translation, noise, stiff, graph, structure.stretches)
    weight = jnp.concatenate([weight, inner.stretch_weight])
    pull = jnp.einsum("qab,qb->qa", inner.stretch_weight, inner.stretch_drift)
    own = (squared / stiff).at[structure.stretches.edge].get(mode="fill", fill_value=0.0)
    settled = 0.5 * (jnp.sum(own) - jnp.sum(pull * inner.stretch_drift))
    return Condensed(weight, jnp.concatenate([force, pull]), inner, settled)


# A rejected edge keeps a trace of its stiffness (not of its force): what hangs on such edges alone must not float.
_TRACE = 1e-9


def edge_weights(squared: Float[Array, "m"], graph: ClosureGraph) -> Float[Array, "m"]:
    """Weights of the edges, those of the robust loss (iteratively reweighted least squares) included."""
    if graph.loss == "none":
        return graph.weight
    robust = robust_weight(squared, graph.loss, graph.loss_width)
    return graph.weight * jnp.where(graph.doubted > 0, robust, 1.0)


def on_joints(per_tie: Float[Array, "e 6"], first: Array, second: Array, n: int) -> Float[Array, "n 6"]:
    """Forces on ties gathered at their joints."""
    return jnp.zeros((n, 6)).at[second].add(per_tie).at[first].add(-per_tie)


def all_increments(at_joints: Float[Array, "j 6"], problem: Condensed, graph: ClosureGraph) -> Float[Array, "6 n"]:
    """Increments of all poses from those of the joints; pose 0 stays where it is."""
    structure = graph.structure
    n = graph.base.t[0].shape[0]
    increments = jnp.zeros((n, 6)).at[structure.joint].set(at_joints, mode="drop")
    inner, stretches = problem.inner, structure.stretches
    if inner is not None and stretches is not None:
        difference = (at_joints[structure.second] - at_joints[structure.first])[-stretches.start.shape[0] :]
        pull = jnp.einsum("qab,qb->qa", inner.stretch_weight, difference - inner.stretch_drift)
        own = pull.at[stretches.stretch].get(mode="fill", fill_value=0.0)
        moved = inner.drift + jnp.einsum("sab,sb->sa", inner.covariance, own)
        total = prefix_sum(moved.T).T
        before = total[stretches.start] - moved[stretches.start]
        from_joint = at_joints[stretches.joint_from] - before
        increments = increments.at[stretches.pose].set(
            from_joint.at[stretches.stretch].get(mode="fill", fill_value=0.0) + total, mode="drop"
        )
    return (increments - increments[:1]).T


def _at_second(poses: Poses, graph: ClosureGraph) -> tuple[Mat3, Vec3]:
    second = graph.edges.second
    quat, t = jax.tree.map(lambda c: c[second], (poses.quat, poses.t))
    return soa.quat_matrix(quat), t


def _inverse(m: Mat3) -> Mat3:
    """By the adjugate; used on a rotation times a right Jacobian, whose determinant is at least 0.4."""
    columns = (soa.cross(m[1], m[2]), soa.cross(m[2], m[0]), soa.cross(m[0], m[1]))
    over = 1.0 / soa.dot(m[0], columns[0])
    return soa.transpose(tuple(soa.scale(over, c) for c in columns))  # type: ignore[arg-type]


def _block(six: Float[Array, "6 6 m"], row: int, column: int) -> Mat3:
    """A 3x3 block as component vectors."""
    return tuple(tuple(six[row + i, column + j] for j in range(3)) for i in range(3))  # type: ignore[return-value]


def _stacked(tt: Mat3, tr: Mat3, rr: Mat3) -> Float[Array, "m 6 6"]:
    """Symmetric 6x6 blocks from their 3x3 ones."""
    rt = soa.transpose(tr)
    rows = [[*tt[i], *tr[i]] for i in range(3)] + [[*rt[i], *rr[i]] for i in range(3)]
    return jnp.stack([c for row in rows for c in row], axis=-1).reshape(-1, 6, 6)


def _weights(
    a: Mat3, b: Mat3, information: Float[Array, "6 6 m"], noise: tuple[Vec3, Vec3], always: Array
) -> tuple[Float[Array, "m 6 6"], Float[Array, "m 6"]]:
    """`W = G^-T Omega G^-1` and `f = -G^-T Omega r` with `G = [[a, b], [0, a]]`."""
    p = _inverse(a)
    s: Mat3 = jax.tree.map(jnp.negative, soa.matmul(soa.matmul(p, b), p))
    p, s = compute_once(always, (p, s))
    pt, st = soa.transpose(p), soa.transpose(s)
    tt, tr, rr = (_block(information, *at) for at in ((0, 0), (0, 3), (3, 3)))
    # Omega G^-1, its columns (translation | rotation)
    top_t = soa.matmul(tt, p)
    top_r = soa.mat_add(soa.matmul(tt, s), soa.matmul(tr, p))
    bottom_r = soa.mat_add(soa.matmul(soa.transpose(tr), s), soa.matmul(rr, p))
    top_t, top_r, bottom_r = compute_once(always, (top_t, top_r, bottom_r))
    weight = _stacked(
        soa.matmul(pt, top_t), soa.matmul(pt, top_r), soa.mat_add(soa.matmul(st, top_r), soa.matmul(pt, bottom_r))
    )
    on_trans = soa.add(soa.matvec(tt, noise[0]), soa.matvec(tr, noise[1]))
    on_rot = soa.add(soa.matvec(soa.transpose(tr), noise[0]), soa.matvec(rr, noise[1]))
    rows = (*soa.matvec(pt, on_trans), *soa.add(soa.matvec(st, on_trans), soa.matvec(pt, on_rot)))
    return weight, -jnp.stack(rows, axis=-1)


def _inner(
    a: Mat3,
    b: Mat3,
    rotation: Mat3,
    translation: Vec3,
    noise: tuple[Vec3, Vec3],
    stiff: Float[Array, "m"],
    graph: ClosureGraph,
    stretches: Stretches,
) -> Inner:
    """Covariance `G Omega^-1 G'` and drift `-Ad(T) r` of the edges on stretches, and what they add up to."""
    turned = tuple(soa.matvec(rotation, part) for part in noise)
    drift = jnp.stack([*soa.add(turned[0], soa.cross(translation, turned[1])), *turned[1]], axis=-1)
    at, bt = soa.transpose(a), soa.transpose(b)
    tt, tr, rr = (_block(graph.edges.covariance, *place) for place in ((0, 0), (0, 3), (3, 3)))
    # G C, its columns (translation | rotation)
    top_t = soa.mat_add(soa.matmul(a, tt), soa.matmul(b, soa.transpose(tr)))
    top_r = soa.mat_add(soa.matmul(a, tr), soa.matmul(b, rr))
    bottom_r = soa.matmul(a, rr)
    covariance = _stacked(
        soa.mat_add(soa.matmul(top_t, at), soa.matmul(top_r, bt)), soa.matmul(top_r, at), soa.matmul(bottom_r, at)
    )
    relax = 1.0 / stiff
    here = stretches.edge
    covariance = (covariance * relax[:, None, None]).at[here].get(mode="fill", fill_value=0.0)
    drift = (-drift * relax[:, None]).at[here].get(mode="fill", fill_value=0.0) * stretches.sign[:, None]
    q = stretches.start.shape[0]
    total = jnp.zeros((q, 6, 6)).at[stretches.stretch].add(covariance, mode="drop")
    empty = (jnp.diagonal(total, axis1=1, axis2=2).sum(-1) == 0)[:, None, None]
    eye = jnp.broadcast_to(jnp.eye(6), total.shape)
    weight = jnp.where(empty, 0.0, jnp.linalg.inv(jnp.where(empty, eye, total)))
    weight = 0.5 * (weight + jnp.swapaxes(weight, 1, 2))
    return Inner(covariance, drift, weight, jnp.zeros((q, 6)).at[stretches.stretch].add(drift, mode="drop"))
