"""The batch job's own problem under a noise ensemble, on arrays of fixed size, from where the last solve ended."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgeo.graph import components as noise
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.online import joint
from jaxgeo.online.frame_known import FrameKnown, frame_known
from jaxgeo.online.joint import N_ERRORS, LastPose, at_pose, conditioned
from jaxgeo.online.warm_start import Given, LastSolution, carried_on, chain_of_given
from jaxgeo.solve.anchor_system import AnchorSystem, Observed, State
from jaxgeo.solve.drift import BLOCKS, Drift, block_correlation, covariance_between, own_covariance
from jaxgeo.solve.ensemble import SetSolution
from jaxgeo.solve.ensemble_fold import EnsembleFold, fold_of, observe, settle, start_of
from jaxgeo.solve.fold import FoldOptions


class EnsembleSolved(eqx.Module):
    """Whether the anchors fix the frame; a solution, its last pose, and what the next solve starts from."""

    known: FrameKnown
    fold: EnsembleFold
    moved_m: Float[Array, ""]
    last_pose: LastPose
    last: LastSolution


@functools.partial(jax.jit, static_argnames="options")
def ensemble_solved(
    given: Given,
    ensemble: NoiseEnsemble,
    loss_width: Float[Array, ""],
    last: LastSolution | None,
    options: FoldOptions,
) -> EnsembleSolved:
    """Steps to the mean of the sets' predictions, from the last solution or, where there is none, the coarse fit."""
    chain, table = chain_of_given(given), given.table
    observed, origin = observe(chain, table, table.real, jnp.zeros_like(table.real), loss_width, options)
    observed = eqx.tree_at(lambda o: o.correlation_m, observed, ensemble.correlation_m)
    start = start_of(observed)
    if last is not None:
        start = State(carried_on(last, chain, origin), last.log_scale, start.offset_m)

    state, sets, system, rounds, moved = settle(start, observed, ensemble)
    fold = fold_of(observed, ensemble, state, sets, origin, table, rounds, moved)
    last_pose = _last_pose(state, system, sets, ensemble, observed, origin)
    carried = LastSolution(state.poses, given.count, origin, state.log_scale)
    return EnsembleSolved(frame_known(observed.graph), fold, moved, last_pose, carried)


def _last_pose(
    state: State,
    system: AnchorSystem,
    sets: SetSolution,
    ensemble: NoiseEnsemble,
    observed: Observed,
    origin_m: Float[Array, "3"],
) -> LastPose:
    """The last pose and the constants: the sets' mean, and their covariance with the spread between them."""
    position, quat = (jnp.stack([c[-1] for c in part]) for part in (state.poses.t, state.poses.quat))
    lever = jnp.zeros((N_ERRORS, 6)).at[:6].set(jnp.eye(6))
    prior, cross = _prior_and_cross(system, observed)

    def one(sigma: Float[Array, "n"], found: SetSolution) -> tuple[Array, Array]:
        variance = sigma**2
        c = jnp.einsum("c,cem->em", variance, cross) * system.known[None]
        own = jnp.einsum("c,cef->ef", variance, prior)
        free = found.gauge_covariance
        covariance, _ = conditioned(own, c, lever, found.factor, found.whitened_gauge, free)
        return lever @ found.gauge - c @ found.multiplier, covariance

    mean, covariance = jax.vmap(one)(ensemble.sigma, sets)
    centre = ensemble.weight @ mean
    apart = at_pose_rows(position, mean - centre[None])
    total = jnp.einsum("q,qef->ef", ensemble.weight, covariance)
    total = at_pose(position, total) + jnp.einsum("q,qe,qf->ef", ensemble.weight, apart, apart)
    return LastPose(position + origin_m, quat, centre[6:], total)


def at_pose_rows(position_m: Float[Array, "3"], errors: Float[Array, "q e"]) -> Float[Array, "q e"]:
    """`at_pose` of errors instead of a covariance: dp = dt + dr x p."""
    moved = errors[:, :3] + jnp.cross(errors[:, 3:6], position_m[None])
    return errors.at[:, :3].set(moved)


def _prior_and_cross(system: AnchorSystem, observed: Observed) -> tuple[Float[Array, "n e e"], Float[Array, "n e m"]]:
    """Prior covariance of the errors under unit noise of each component, and theirs with the anchors' rows.

    The chain's part of the pose leaves the bounded error out: that is an error of its own.
    """
    drift, correlation = system.drift, observed.correlation_m
    k, d, _ = system.jacobian.shape
    m = k * d
    # The last row of the anchors is padding and hangs on the last pose: its drift is there already.
    here = Drift(
        drift.index[-1:],
        drift.white[:, -1:],
        drift.constant[-1:],
        drift.block[-1:],
        drift.distance_m[-1:],
        drift.block_length_m,
    )
    eye = jnp.eye(6)[None]
    on_pose = covariance_between(eye, here, system.jacobian, drift, correlation).at[noise.BOUNDED].set(0.0)
    own = own_covariance(eye, here, correlation)[:, 0].at[noise.BOUNDED].set(0.0)
    cross = jnp.zeros((noise.N_COMPONENTS, N_ERRORS, m)).at[:, :6].set(on_pose)
    prior = jnp.zeros((noise.N_COMPONENTS, N_ERRORS, N_ERRORS)).at[:, :6, :6].set(own)

    near = block_correlation(drift, correlation)[BLOCKS - 1]  # of the last stretch with every other
    on_constant = jnp.einsum("lda,lac->cld", system.jacobian, drift.constant).reshape(-1, m)
    on_wander = jnp.einsum("lda,lbac,b->cld", system.jacobian, drift.block, near).reshape(-1, m)
    pose_wander = jnp.einsum("bac,b->ac", drift.block[-1], near)
    for component, errors, columns, rows, pose in (
        (noise.BIAS_TRANS, joint.BIAS_TRANS, slice(0, 3), on_constant, drift.constant[-1]),
        (noise.BIAS_ROT, joint.BIAS_ROT, slice(3, 6), on_constant, drift.constant[-1]),
        (noise.LOG_SCALE, slice(joint.LOG_SCALE, joint.LOG_SCALE + 1), slice(6, 7), on_constant, drift.constant[-1]),
        (noise.LOG_TURN, slice(joint.LOG_TURN, joint.LOG_TURN + 1), slice(7, 8), on_constant, drift.constant[-1]),
        (noise.WANDER_TRANS, joint.WANDER_TRANS, slice(0, 3), on_wander, pose_wander),
        (noise.WANDER_ROT, joint.WANDER_ROT, slice(3, 6), on_wander, pose_wander),
        (noise.WANDER_SCALE, slice(joint.WANDER_SCALE, joint.WANDER_SCALE + 1), slice(6, 7), on_wander, pose_wander),
    ):
        cross = cross.at[component, errors].set(rows[columns])
        prior = prior.at[component, errors, errors].set(jnp.eye(columns.stop - columns.start))
        prior = prior.at[component, :6, errors].set(pose[:, columns])
        prior = prior.at[component, errors, :6].set(pose[:, columns].T)

    fade = jnp.exp(-jnp.abs(here.distance_m - drift.distance_m) / correlation)
    bounded = jnp.einsum("lda,l->ald", system.jacobian[..., :3], fade).reshape(3, m)
    cross = cross.at[noise.BOUNDED, joint.BOUNDED].set(bounded)
    return prior.at[noise.BOUNDED, joint.BOUNDED, joint.BOUNDED].set(jnp.eye(3)), cross
