"""One choice of anchors under a given noise ensemble: solved, and what it predicts for every marker and pose."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.graph.pose_graph import at_anchors
from jaxgeo.solve.anchor_system import AnchorSystem, Observed, State, anchor_system, chain_linearised
from jaxgeo.solve.drift import covariance_between, drift_at, own_covariance, path_length_m
from jaxgeo.solve.ensemble import SetSolution, ensemble_step, mixture, solve_set
from jaxgeo.solve.fold import FoldOptions, fold_graph, sqrt_information
from jaxgeo.solve.linearise import hat
from jaxgeo.solve.measurement_space import farthest_m

# Steps before a trajectory counts as not settled, and what settled means: no marker moves by more. Poses far from all
# markers, which are the last to settle, are waited for; they do not count, for they are the least certain.
MAX_ROUNDS = 25
SETTLED_M = 1e-4
# Wander and bounded error forget over this share of the path between the first and the last anchor.
CORRELATION_SHARE = 0.1
# Poses whose covariance is worked out at a time.
CHUNK = 64
# A graph holds a noise; under an ensemble it is not read.
_UNREAD = odometry_noise(1.0, 1.0, sigma_log_scale=1.0)


class EnsembleFold(eqx.Module):
    """One choice of anchors, solved under an ensemble. (k) rows are all anchors, used or not.

    Attributes:
        observed: graph, weights and masks; `ensemble` the noise.
        state: corrected poses in the graph's frame; `origin_m` what that frame has subtracted from the local frame.
        point_m: (k, 3) markers as predicted, local frame.
        point_covariance_m2: (k, 3, 3) of the prediction; `error_covariance_m2` of it minus the surveyed position, for
            an anchor that was not used.
        rounds: steps taken; `settled` whether the last moved no marker by more than `SETTLED_M`.
    """

    observed: Observed
    ensemble: NoiseEnsemble
    state: State
    origin_m: Float[Array, "3"]
    point_m: Float[Array, "k 3"]
    point_covariance_m2: Float[Array, "k 3 3"]
    error_covariance_m2: Float[Array, "k 3 3"]
    rounds: Int[Array, ""]
    settled: Bool[Array, ""]


def observe(
    chain: Chain,
    table: AnchorTable,
    use: Float[Array, "k"],
    relative: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
) -> tuple[Observed, Float[Array, "3"]]:
    """The graph of the used anchors at their coarse fit, with the sightings of the relative ones; and its origin."""
    graph, _, _, origin = fold_graph(chain, table, _UNREAD, use, loss_width, options)
    rotation = at_anchors(graph.base, graph).rotation
    seen = sqrt_information(rotation @ table.lever_covariance_m2 @ jnp.swapaxes(rotation, -1, -2))
    weight = jnp.where((relative > 0)[:, None, None], seen, graph.anchors.sqrt_information)
    graph = eqx.tree_at(lambda g: g.anchors.sqrt_information, graph, weight)
    distance = path_length_m(graph)[table.pose_index]
    first, last = (jnp.where(use > 0, distance, far) for far in (jnp.inf, -jnp.inf))
    span = jnp.maximum(jnp.max(last) - jnp.min(first), 1.0)
    # The survey of a location that is not used is not read.
    survey = jnp.where((use > 0)[:, None, None], table.survey_covariance_m2, 0.0)
    return Observed(graph, use, relative, table.location, survey, span, CORRELATION_SHARE * span), origin


def start_of(observed: Observed) -> State:
    """The state at the coarse fit."""
    graph = observed.graph
    zero = jnp.zeros_like(graph.chain.length_m)
    return State(graph.base, graph.base_globals.log_scale, (zero, zero, zero))


def move(state: State, observed: Observed, ensemble: NoiseEnsemble) -> tuple[State, SetSolution, AnchorSystem]:
    """One step under a known ensemble."""
    linear = chain_linearised(state, observed.graph)
    system = anchor_system(state, linear, observed)
    solved = jax.vmap(lambda sigma: solve_set(system, sigma))(ensemble.sigma)
    return ensemble_step(state, linear, system, solved, ensemble, observed), solved, system


def marker_m(state: State, observed: Observed) -> Float[Array, "k 3"]:
    """Markers as the state has them, its bounded error included."""
    index = observed.graph.anchors.pose_index
    return at_anchors(state.poses, observed.graph).point_m + jnp.stack([c[index] for c in state.offset_m], axis=-1)


def moved_m(before: State, after: State, observed: Observed) -> Float[Array, ""]:
    """Largest movement of a marker between two states; NaN counts as infinite."""
    moved = jnp.linalg.norm(marker_m(after, observed) - marker_m(before, observed), axis=1)
    return jnp.max(jnp.nan_to_num(moved, nan=jnp.inf))


def settle(
    start: State, observed: Observed, ensemble: NoiseEnsemble
) -> tuple[State, SetSolution, AnchorSystem, Int[Array, ""], Float[Array, ""]]:
    """Steps until nothing moves by more than `SETTLED_M`; their number, and what the last moved a marker by."""

    def again(carry: tuple) -> tuple:
        rounds, _, _, state, _, _ = carry
        new, solved, system = move(state, observed, ensemble)
        return rounds + 1, moved_m(state, new, observed), farthest_m(state.poses, new.poses), new, solved, system

    def unsettled(carry: tuple) -> Array:
        rounds, marker_moved_m, pose_moved_m, *_ = carry
        return (rounds < MAX_ROUNDS) & ~((marker_moved_m < SETTLED_M) & (pose_moved_m < SETTLED_M))

    state, solved, system = move(start, observed, ensemble)
    first = jnp.array(1), moved_m(start, state, observed), farthest_m(start.poses, state.poses)
    rounds, moved, _, state, solved, system = jax.lax.while_loop(unsettled, again, (*first, state, solved, system))
    return state, solved, system, rounds, moved


@functools.partial(jax.jit, static_argnames="options")
def solve_ensemble(
    chain: Chain,
    table: AnchorTable,
    ensemble: NoiseEnsemble,
    use: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
) -> EnsembleFold:
    """Correct with the anchors whose `use` is 1 under a known ensemble; `options.terms.log_scale` must be on."""
    use = use * table.real
    observed, origin = observe(chain, table, use, jnp.zeros_like(use), loss_width, options)
    observed = eqx.tree_at(lambda o: o.correlation_m, observed, ensemble.correlation_m)

    state, solved, _, rounds, moved = settle(start_of(observed), observed, ensemble)
    return fold_of(observed, ensemble, state, solved, origin, table, rounds, moved)


def fold_of(
    observed: Observed,
    ensemble: NoiseEnsemble,
    state: State,
    solved: SetSolution,
    origin: Float[Array, "3"],
    table: AnchorTable,
    rounds: Int[Array, ""],
    moved: Float[Array, ""],
) -> EnsembleFold:
    """Gather the sets' predictions."""
    point, covariance = mixture(solved.point_m, solved.point_covariance_m2, ensemble.weight)
    rotation = at_anchors(state.poses, observed.graph).rotation
    seen = rotation @ table.lever_covariance_m2 @ jnp.swapaxes(rotation, -1, -2)
    error = covariance + seen + table.survey_covariance_m2
    settled = moved < SETTLED_M
    return EnsembleFold(observed, ensemble, state, origin, point + origin[None], covariance, error, rounds, settled)


@jax.jit
def covariance_at(fold: EnsembleFold, index: Int[Array, "p"]) -> Float[Array, "p 6 6"]:
    """Covariance of poses: position error added, rotation error multiplied on the left, grid axes.

    The sets' mean and the spread between them; the length of `index` must divide by `CHUNK`.
    """
    observed, ensemble = fold.observed, fold.ensemble
    graph = observed.graph
    linear = chain_linearised(fold.state, graph)
    system = anchor_system(fold.state, linear, observed)
    solved = jax.vmap(lambda sigma: solve_set(system, sigma))(ensemble.sigma)
    position = jnp.stack(fold.state.poses.t, axis=-1)

    def chunk(some: Int[Array, "c"]) -> Float[Array, "c 6 6"]:
        drift = drift_at(linear.edges, graph, some)
        eye = jnp.broadcast_to(jnp.eye(6), (CHUNK, 6, 6))
        # From increments about the origin to errors at the pose itself: dp = dt + dr x p.
        left = eye.at[:, :3, 3:].set(-hat(position[some]))
        cross = covariance_between(left, drift, system.jacobian, system.drift, observed.correlation_m)
        own = own_covariance(left, drift, observed.correlation_m)

        def one(sigma: Array, set_: SetSolution) -> tuple[Array, Array]:
            variance = sigma**2
            c = jnp.einsum("c,cxy->xy", variance, cross) * system.known[None]
            whitened = jax.scipy.linalg.solve_triangular(set_.factor, c.T, lower=True).T.reshape(CHUNK, 6, -1)
            lever = left - whitened @ set_.whitened_gauge
            covariance = jnp.einsum("c,ciab->iab", variance, own) - whitened @ jnp.swapaxes(whitened, -1, -2)
            covariance = covariance + lever @ set_.gauge_covariance @ jnp.swapaxes(lever, -1, -2)
            return left @ set_.gauge - (c @ set_.multiplier).reshape(CHUNK, 6), covariance

        mean, covariance = jax.vmap(one)(ensemble.sigma, solved)
        return mixture(mean, covariance, ensemble.weight)[1]

    found = jax.lax.map(chunk, index.reshape(-1, CHUNK)).reshape(-1, 6, 6)
    return 0.5 * (found + jnp.swapaxes(found, -1, -2))
