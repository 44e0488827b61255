"""The whole tail for one choice of anchors, as one pure function: coarse fit, pose graph, predictions.

Everything a fold does with coordinates goes through `use`: anchors whose `use` is 0 are replaced by zeros before they
are read, so that not a bit of them reaches the coarse fit, the origin, the weights or the graph. One `jit`, any number
of folds.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxgeo.geometry.se3 import so3_from_matrix
from jaxgeo.geometry.sim3 import Sim3, sim3_apply
from jaxgeo.geometry.umeyama import umeyama
from jaxgeo.graph import soa
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain, Poses
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.graph.pose_graph import AnchorRows, Globals, PoseGraph, Terms, at_anchors, zero_globals
from jaxgeo.solve.gauge import determined, gauge_covariance
from jaxgeo.solve.linearise import hat
from jaxgeo.solve.posterior import globals_covariance, pose_covariance, posterior
from jaxgeo.solve.solver import MAX_STEPS, Solution, solve_graph

# Folds solved at a time. On CPUs one is as fast as eight, and half as long in tracing; on a GPU take hundreds.
FOLD_BATCH = 1


@dataclasses.dataclass(frozen=True)
class FoldOptions:
    """Choices that compile their own program.

    Attributes:
        coarse_scale, coarse_gravity: of the one-time similarity.
        terms: what the graph contains.
        max_steps: trial steps before a solve counts as not converged.
    """

    coarse_scale: bool = True
    coarse_gravity: bool = False
    terms: Terms = dataclasses.field(default_factory=Terms)
    max_steps: int = MAX_STEPS


class Fold(eqx.Module):
    """One choice of anchors, solved. Positions are in the session's local frame; (k) rows are all anchors, used or not.

    Attributes:
        coarse: the one-time similarity, map frame (minus the chain's origin) to local frame; `coarse_rms_m` over used.
        coarse_point_m, point_m: (k, 3) marker positions that the coarse fit and the graph predict.
        error_covariance_m2: (k, 3, 3) of `point_m` minus the surveyed position, for an anchor that was not used.
        origin_m: what the graph's frame has subtracted from the local frame.
        solution: poses in the graph's frame.
        log_scale_sigma: posterior standard deviation of the log-scale.
        gauge_sigma, gauge_direction: see `gauge.gauge_covariance`.
        determined: whether the used anchors fix the frame; where not, nothing else here means anything.
    """

    coarse: Sim3
    coarse_rms_m: Float[Array, ""]
    coarse_point_m: Float[Array, "k 3"]
    point_m: Float[Array, "k 3"]
    error_covariance_m2: Float[Array, "k 3 3"]
    origin_m: Float[Array, "3"]
    solution: Solution
    log_scale_sigma: Float[Array, ""]
    gauge_sigma: Float[Array, "6"]
    gauge_direction: Float[Array, "6 6"]
    determined: Bool[Array, ""]


@functools.partial(jax.jit, static_argnames="options")
def solve_fold(
    chain: Chain,
    table: AnchorTable,
    noise: OdometryNoise,
    use: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
) -> tuple[Fold, PoseGraph]:
    """Coarse fit, pose graph and predictions with the anchors whose `use` is 1."""
    use = use * table.real
    graph, coarse, coarse_rms, origin = fold_graph(chain, table, noise, use, loss_width, options)
    point = _map_points(chain, table)
    # Where the anchors were surveyed, not where the map has them: drift between two visits of one point is no baseline.
    sigma, direction = gauge_covariance(
        graph.anchors.measured_m, graph.anchors.sqrt_information, _rotation_information(graph, options)
    )
    solution = solve_graph(graph, options.max_steps)
    at = at_anchors(solution.poses, graph)
    post = posterior(graph, solution.poses, solution.glob)
    pose = pose_covariance(post, table.pose_index)
    lever = at.point_m - jnp.stack([c[table.pose_index] for c in solution.poses.t], axis=-1)
    reach = jnp.concatenate([jnp.broadcast_to(jnp.eye(3), (*use.shape, 3, 3)), -hat(lever)], axis=-1)
    error = reach @ pose @ jnp.swapaxes(reach, -1, -2) + _position_covariance(table, at.rotation)
    scale_sigma = jnp.sqrt(globals_covariance(post)[-1, -1]) if options.terms.log_scale else jnp.zeros(())
    coarse_point = jax.vmap(lambda p: sim3_apply(coarse, p))(point)
    ok = determined(sigma, direction)
    fold = Fold(
        coarse,
        coarse_rms,
        coarse_point,
        at.point_m + origin[None],
        error,
        origin,
        solution,
        scale_sigma,
        sigma,
        direction,
        ok,
    )
    return fold, graph


def fold_graph(
    chain: Chain,
    table: AnchorTable,
    noise: OdometryNoise,
    use: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
) -> tuple[PoseGraph, Sim3, Float[Array, ""], Float[Array, "3"]]:
    """The graph of the used anchors, started at their coarse fit, about an origin of its own; fit, its RMS, origin."""
    used = use > 0
    surveyed = jnp.where(used[:, None], table.surveyed_m, 0.0)
    # Whole metres: subtracting them is exact, whatever the session's own origin was.
    origin = jnp.round(surveyed.sum(axis=0) / jnp.maximum(use.sum(), 1.0))
    local = jnp.where(used[:, None], surveyed - origin[None], 0.0)
    point = _map_points(chain, table)
    terms = options.terms
    fit = umeyama(point, local, use, scale=options.coarse_scale, gravity=options.coarse_gravity)
    start = umeyama(point, local, use, scale=terms.log_scale, gravity=options.coarse_gravity).sim3
    base = _moved(chain.start, start)
    glob = zero_globals()
    if terms.log_scale:
        glob = Globals(glob.bias_trans, glob.bias_rot, jnp.log(start.scale))
    rotation = _rotations(base, table.pose_index)
    weight = jnp.where(used[:, None, None], sqrt_information(_position_covariance(table, rotation)), 0.0)
    turned = (used & (table.has_rotation > 0))[:, None, None]
    rows = AnchorRows(
        table.pose_index,
        table.later_than,
        table.lever_arm_m,
        local,
        weight,
        jnp.where(turned, table.rotation, jnp.eye(3)),
        jnp.where(turned, sqrt_information(table.rotation_covariance_rad2), 0.0),
    )
    graph = PoseGraph(chain, rows, noise, base, glob, loss_width, terms)
    coarse = Sim3(fit.sim3.scale, fit.sim3.rotation, fit.sim3.translation_m + origin)
    return graph, coarse, fit.rms_m, origin


def sqrt_information(covariance: Float[Array, "k 3 3"]) -> Float[Array, "k 3 3"]:
    """W with W'W the inverse of the covariance: the inverse of its lower Cholesky factor."""
    factor = jnp.linalg.cholesky(covariance)
    return jax.scipy.linalg.solve_triangular(factor, jnp.broadcast_to(jnp.eye(3), factor.shape), lower=True)


def _position_covariance(table: AnchorTable, rotation: Float[Array, "k 3 3"]) -> Float[Array, "k 3 3"]:
    """What was measured, turned into the grid, and what was surveyed."""
    return rotation @ table.lever_covariance_m2 @ jnp.swapaxes(rotation, -1, -2) + table.survey_covariance_m2


def _rotations(poses: Poses, index: Int[Array, "k"]) -> Float[Array, "k 3 3"]:
    rows = soa.quat_matrix(jax.tree.map(lambda c: c[index], poses.quat))
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def _rotation_information(graph: PoseGraph, options: FoldOptions) -> Float[Array, "k 3 3"]:
    """Information of the surveyed rotations about the grid's axes; zero where the graph does not use them."""
    rotation = _rotations(graph.base, graph.anchors.pose_index)
    weight = graph.anchors.sqrt_information_rotation @ jnp.swapaxes(rotation, -1, -2)
    return jnp.swapaxes(weight, -1, -2) @ weight * float(options.terms.rotation)


def _map_points(chain: Chain, table: AnchorTable) -> Float[Array, "k 3"]:
    """Marker positions in the map frame (minus the chain's origin), as the odometry alone has them."""
    rotation = _rotations(chain.start, table.pose_index)
    position = jnp.stack([c[table.pose_index] for c in chain.start.t], axis=-1)
    return jnp.einsum("kij,kj->ki", rotation, table.lever_arm_m) + position


def _moved(poses: Poses, sim3: Sim3) -> Poses:
    """The chain after a similarity."""
    turn = tuple(so3_from_matrix(sim3.rotation))
    x, y, z = (
        sim3.scale * sum((sim3.rotation[i, j] * poses.t[j] for j in range(3)), jnp.zeros(())) + sim3.translation_m[i]
        for i in range(3)
    )
    return Poses(soa.quat_mul(turn, poses.quat), (x, y, z))


@functools.partial(jax.jit, static_argnames=("options", "batch"))
def solve_folds(
    chain: Chain,
    table: AnchorTable,
    noise: OdometryNoise,
    use: Float[Array, "f k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
    batch: int = FOLD_BATCH,
) -> tuple[Fold, Poses]:
    """Every row of `use` a fold, all in one compiled program, and the poses of the first.

    `batch` folds are solved at a time, by `vmap`. The folds' own poses are not kept: they would be folds x poses large.
    """

    def one(row: Float[Array, "k"]) -> Fold:
        return solve_fold(chain, table, noise, row, loss_width, options)[0]

    def several(first: tuple[Array, Poses], rows: Float[Array, "b k"]) -> tuple[tuple[Array, Poses], Fold]:
        fold = jax.tree.map(lambda x: x[None], one(rows[0])) if batch == 1 else jax.vmap(one)(rows)
        done, poses = first
        poses = jax.tree.map(lambda old, new: jnp.where(done, old, new[0]), poses, fold.solution.poses)
        nothing = jax.tree.map(lambda c: jnp.zeros((batch, 1)), fold.solution.poses)
        return (jnp.array(True), poses), eqx.tree_at(lambda f: f.solution.poses, fold, nothing)

    # Whole batches only: a remainder would be traced and compiled a second time.
    folds = use.shape[0]
    padded = jnp.pad(use, ((0, -folds % batch), (0, 0)), mode="edge").reshape(-1, batch, use.shape[1])
    (_, poses), found = jax.lax.scan(several, (jnp.array(False), chain.start), padded)
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:folds], found), poses
