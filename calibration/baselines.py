"""Simpler ways to a trajectory's noise, to judge the learned one against: one noise, estimated anew in every fold.

As in `calibration.learn`, estimating and correcting alternate until no marker moves; here an estimator, a function of
the small system of the anchors alone, gives one noise in place of an ensemble of them. Nothing of an anchor that a fold
does not use is read, but, where `relative` says so, the differences between its location's visits.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from calibration.learn import LearnOptions
from calibration.observations import learnable
from calibration.reml import Contrasts, contrasts
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.anchor_system import AnchorSystem, Observed, State, anchor_system, chain_linearised
from jaxgeo.solve.ensemble import SetSolution, ensemble_step, solve_set
from jaxgeo.solve.ensemble_fold import MAX_ROUNDS, SETTLED_M, EnsembleFold, fold_of, moved_m, observe, start_of


class Given(eqx.Module):
    """What an estimator may look at: the anchors' system, its contrasts, and the fixed noise as a first guess."""

    system: AnchorSystem
    found: Contrasts
    observed: Observed
    noise: OdometryNoise


Estimator = Callable[[Given], OdometryNoise]


class PointFold(eqx.Module):
    """What is kept of a fold, one row of `use`.

    Attributes:
        point_m: (k, 3) markers as predicted, local frame.
        error_covariance_m2: (k, 3, 3) of it minus the surveyed position, for an anchor that was not used.
        ensemble: the noise that it was predicted with.
        rounds, settled: see `EnsembleFold`.
    """

    point_m: Float[Array, "k 3"]
    error_covariance_m2: Float[Array, "k 3 3"]
    ensemble: NoiseEnsemble
    rounds: Int[Array, ""]
    settled: Bool[Array, ""]


def points_of(fold: EnsembleFold) -> PointFold:
    """A fold without its poses: of all folds they would be folds x poses large."""
    return PointFold(fold.point_m, fold.error_covariance_m2, fold.ensemble, fold.rounds, fold.settled)


@functools.partial(jax.jit, static_argnames=("options", "estimate"))
def estimated_folds(
    chain: Chain,
    table: AnchorTable,
    noise: OdometryNoise,
    use: Float[Array, "f k"],
    loss_width: Float[Array, ""],
    options: LearnOptions,
    estimate: Estimator,
) -> PointFold:
    """Every row of `use` a fold with a noise of its own, one after the other in one compiled program.

    `noise` is the estimator's first guess; `estimate` must be a function of a module: another one compiles anew.
    """

    def one(row: Float[Array, "k"]) -> PointFold:
        return points_of(_estimated_fold(chain, table, noise, row, loss_width, options, estimate))

    return jax.lax.map(one, use)


def _estimated_fold(
    chain: Chain,
    table: AnchorTable,
    noise: OdometryNoise,
    use: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: LearnOptions,
    estimate: Estimator,
) -> EnsembleFold:
    use = use * table.real
    masks = learnable(table, use, options.observations)
    observed, origin = observe(chain, table, use, masks.relative, loss_width, options.fold)

    def one_round(state: State) -> tuple[State, SetSolution, NoiseEnsemble]:
        linear = chain_linearised(state, observed.graph)
        system = anchor_system(state, linear, observed)
        ensemble = ensemble_of(estimate(Given(system, contrasts(system, masks), observed, noise)))
        solved = jax.vmap(lambda sigma: solve_set(system, sigma))(ensemble.sigma)
        return ensemble_step(state, linear, system, solved, ensemble, observed), solved, ensemble

    def unsettled(carry: tuple) -> Array:
        return (carry[0] < MAX_ROUNDS) & ~(carry[1] < SETTLED_M)

    def again(carry: tuple) -> tuple:
        rounds, _, state, *_ = carry
        new, *rest = one_round(state)
        return rounds + 1, moved_m(state, new, observed), new, *rest

    start = start_of(observed)
    state, solved, ensemble = one_round(start)
    first = (jnp.array(1), moved_m(start, state, observed), state, solved, ensemble)
    rounds, moved, state, solved, ensemble = jax.lax.while_loop(unsettled, again, first)
    return fold_of(observed, ensemble, state, solved, origin, table, rounds, moved)


def scaled_noise(noise: OdometryNoise, trans: Array, rot: Array, log_scale: Array) -> OdometryNoise:
    """Translation sigmas, rotation sigmas (turns with them) and that of the log-scale, each times a factor."""
    return OdometryNoise(
        noise.sigma_trans_m_per_sqrt_m * trans,
        noise.sigma_rot_rad_per_sqrt_m * rot,
        noise.sigma_turn_rad_per_sqrt_rad * rot,
        noise.sigma_log_scale * log_scale,
        noise.sigma_bias_trans_m_per_m * trans,
        noise.sigma_bias_rot_rad_per_m * rot,
    )
