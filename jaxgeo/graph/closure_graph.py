"""A pose graph with many closures as a least-squares problem: whitened residuals of relative poses.

    r_e = Log(Z_e^-1 T_first^-1 T_second),  cost = sum_e w_e rho(r_e' Omega_e r_e) / 2

with world-frame increments `T_i = Exp(y_i) base_i`. To first order `d r_e = G_e^-1 (y_second - y_first)` with
`G_e = Ad(T_second) J_r(r_e)`: the normal matrix is a graph's Laplacian whose weights are 6x6 matrices
`W_e = G_e^-T Omega_e G_e^-1`, and what moves all poses alike (the gauge) costs nothing.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxgeo.data.relative_poses import RelativePoses
from jaxgeo.geometry.robust import RobustKind, robust_rho
from jaxgeo.graph import se3_soa, soa
from jaxgeo.graph.bucket import pose_bucket
from jaxgeo.graph.chain import Poses, poses_of, relative_motion
from jaxgeo.graph.closure_structure import Structure
from jaxgeo.graph.soa import Vec3


class ClosureEdges(eqx.Module):
    """Relative poses as component vectors of the padded length m; padding ties pose 0 to itself, of zero information.

    Attributes:
        first, second: (m,) poses they tie.
        measured: `T_first_second`.
        information: (6, 6, m) of the residual, (translation, rotation).
        root: (6, 6, m) roots of it: `root' root = information`.
        covariance: (6, 6, m) its inverse, where it has one; zero elsewhere.
    """

    first: Int[Array, "m"]
    second: Int[Array, "m"]
    measured: Poses
    information: Float[Array, "6 6 m"]
    root: Float[Array, "6 6 m"]
    covariance: Float[Array, "6 6 m"]


class ClosureGraph(eqx.Module):
    """Everything the residuals and the solver need. Increments are taken about `base`.

    Attributes:
        weight: (m,) factor of every edge's squared residual.
        doubted: (m,) 1 for edges that the robust loss applies to, 0 for trusted ones.
        loss: robust loss on the doubted edges' whitened residuals.
        loss_width: where it begins.
    """

    base: Poses
    edges: ClosureEdges
    structure: Structure
    weight: Float[Array, "m"]
    doubted: Float[Array, "m"]
    loss_width: Float[Array, ""]
    loss: RobustKind = eqx.field(static=True, default="none")


def closure_edges(
    edges: RelativePoses, root: Float[np.ndarray, "m 6 6"], definite: Bool[np.ndarray, "m"]
) -> ClosureEdges:
    """The edges padded to their bucket.

    Args:
        edges: what was measured.
        root: matrices R with `R'R` the information.
        definite: edges whose information can be inverted.
    """
    m = len(edges)
    padded = pose_bucket(m)
    covariance = np.zeros((m, 6, 6))
    covariance[definite] = np.linalg.inv(edges.information[definite])

    def components(blocks: Float[np.ndarray, "m 6 6"]) -> Float[Array, "6 6 m"]:
        grown = np.zeros((6, 6, padded))
        grown[:, :, :m] = blocks.transpose(1, 2, 0)
        return jnp.asarray(grown)

    def indices(rows: Int[np.ndarray, "m"]) -> Int[Array, "m"]:
        return jnp.asarray(np.pad(rows, (0, padded - m)).astype(np.int32))

    return ClosureEdges(
        indices(edges.first),
        indices(edges.second),
        poses_of(edges.t_m, edges.quat_wxyz, padded),
        components(edges.information),
        components(root),
        components(covariance),
    )


def closure_noise(poses: Poses, edges: ClosureEdges) -> tuple[Vec3, Vec3]:
    """`Log(Z^-1 T_first^-1 T_second)` of every edge, as (translation, rotation)."""

    def at(index: Int[Array, "m"]) -> Poses:
        return Poses(tuple(c[index] for c in poses.quat), tuple(c[index] for c in poses.t))  # type: ignore[arg-type]

    moved = relative_motion(at(edges.first), at(edges.second))
    back = soa.quat_conj(edges.measured.quat)
    return se3_soa.log(soa.quat_mul(back, moved.quat), soa.rotate(back, soa.sub(moved.t, edges.measured.t)))


def times(matrix: Float[Array, "6 6 m"], vector: tuple[Vec3, Vec3]) -> list[Array]:
    """Rows of `matrix @ vector`."""
    v = (*vector[0], *vector[1])
    return [sum((matrix[a, b] * v[b] for b in range(1, 6)), matrix[a, 0] * v[0]) for a in range(6)]


def squared_norms(noise: tuple[Vec3, Vec3], edges: ClosureEdges) -> Float[Array, "m"]:
    """Squared whitened residuals `r' Omega r`."""
    v = (*noise[0], *noise[1])
    force = times(edges.information, noise)
    return sum((a * b for a, b in zip(v[1:], force[1:], strict=True)), v[0] * force[0])


def edge_costs(squared: Float[Array, "m"], graph: ClosureGraph) -> Float[Array, "m"]:
    """Every edge's share of the cost."""
    if graph.loss != "none":
        robust = robust_rho(squared, graph.loss, graph.loss_width)
        squared = jnp.where(graph.doubted > 0, robust, squared)
    return 0.5 * graph.weight * squared


def closure_residuals(y: tuple[Vec3, Vec3], graph: ClosureGraph) -> tuple[Array, ...]:
    """Whitened residuals at increments y, the robust loss folded in: half their squares' sum is the cost."""
    quat, t = se3_soa.exp(*y)
    poses = Poses(soa.quat_mul(quat, graph.base.quat), soa.add(soa.rotate(quat, graph.base.t), t))
    noise = closure_noise(poses, graph.edges)
    squared = squared_norms(noise, graph.edges)
    there = squared > 0
    ratio = jnp.where(there, 2.0 * edge_costs(squared, graph) / jnp.where(there, squared, 1.0), graph.weight)
    counts = ratio > 0  # where not, the root has no derivative
    factor = jnp.where(counts, jnp.sqrt(jnp.where(counts, ratio, 1.0)), 0.0)
    return tuple(factor * row for row in times(graph.edges.root, noise))
