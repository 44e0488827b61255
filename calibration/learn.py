"""Learn the noise of one trajectory from one choice of its anchors, and correct it with what was learned.

Alternates until both settle: linearise at the poses, learn the noise from the contrasts, move the poses to the mean of
what the noise's ensemble predicts. One pure function, so that all leave-one-out folds run in one compiled call; nothing
of an anchor whose `use` is 0 is read but, where `relative` is 1, its sightings, without coordinates.
"""

import dataclasses
import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from calibration.fit import STARTS, ModelFit, fit_family, model_weights
from calibration.models import FamilyPrior
from calibration.observations import ObservationSet, learnable
from calibration.reml import Contrasts, Prior, contrasts
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import N_COMPONENTS, NoiseEnsemble
from jaxgeo.solve.anchor_system import State, anchor_system, chain_linearised
from jaxgeo.solve.ensemble import SetSolution, ensemble_step, solve_set
from jaxgeo.solve.ensemble_fold import MAX_ROUNDS, SETTLED_M, EnsembleFold, fold_of, moved_m, observe, start_of
from jaxgeo.solve.fold import FoldOptions

# Rounds in which the noise is learned anew. Noise and trajectory that have not settled together by then (two optima
# that take turns) are not going to: the noise is held, and the trajectory settles under it.
LEARNING_ROUNDS = 12


def noise_held(rounds: ArrayLike) -> np.ndarray:
    """Whether noise and trajectory did not settle together, by the rounds that were taken."""
    return np.asarray(rounds) > LEARNING_ROUNDS


class FamilyPriorArrays(eqx.Module):
    """`FamilyPrior` as arrays."""

    mean: Float[Array, "n"]
    per_log_span: Float[Array, "n"]
    precision: Float[Array, "models n n"]
    free: Float[Array, "models n"]


def prior_arrays(prior: FamilyPrior) -> FamilyPriorArrays:
    return FamilyPriorArrays(*(jnp.asarray(x) for x in (prior.mean, prior.per_log_span, prior.precision, prior.free)))


class Learned(eqx.Module):
    """What one choice of anchors says of the noise, and where it puts the trajectory.

    Attributes:
        fold: the trajectory under the ensemble of all models' draws.
        fit: every model's posterior; `model_weight` (models,).
        found: the contrasts, linearised where the trajectory settled; `prior` every model's.
    """

    fold: EnsembleFold
    fit: ModelFit
    model_weight: Float[Array, "models"]
    found: Contrasts
    prior: Prior


@dataclasses.dataclass(frozen=True)
class LearnOptions:
    """Choices that compile: those of a fold, and what is learned from. `fold.terms.log_scale` must be on."""

    fold: FoldOptions
    observations: ObservationSet = "both"


class _Round(eqx.Module):
    """One round of learning and moving; `moved_m` is how far the farthest marker went."""

    rounds: Array
    moved_m: Array
    state: State
    fit: ModelFit
    found: Contrasts
    solved: SetSolution
    noise: NoiseEnsemble


@functools.partial(jax.jit, static_argnames="options")
def learn_fold(
    chain: Chain,
    table: AnchorTable,
    prior: FamilyPriorArrays,
    use: Float[Array, "k"],
    loss_width: Float[Array, ""],
    options: LearnOptions,
) -> Learned:
    """Learn from the anchors whose `use` is 1 (and the revisits of others), and correct with the former."""
    use = use * table.real
    masks = learnable(table, use, options.observations)
    observed, origin = observe(chain, table, use, masks.relative, loss_width, options.fold)
    mean = prior.mean + prior.per_log_span * jnp.log(observed.span_m)
    own = Prior(jnp.broadcast_to(mean, prior.free.shape), prior.precision, prior.free)
    start = start_of(observed)
    starts = mean[None, None] + jnp.asarray(STARTS)[None, :, None]
    starts = jnp.broadcast_to(starts, (len(prior.free), len(STARTS), N_COMPONENTS))

    def one_round(before: State, learn: Callable[[Contrasts, Array], ModelFit], rounds: Array) -> _Round:
        linear = chain_linearised(before, observed.graph)
        system = anchor_system(before, linear, observed)
        found = contrasts(system, masks)
        fit = learn(found, rounds)
        noise = ensemble_from(fit, own, observed.correlation_m)
        solved = jax.vmap(lambda sigma: solve_set(system, sigma))(noise.sigma)
        after = ensemble_step(before, linear, system, solved, noise, observed)
        return _Round(rounds, moved_m(before, after, observed), after, fit, found, solved, noise)

    def again(done: _Round) -> _Round:
        def learn(found: Contrasts, rounds: Array) -> ModelFit:
            return jax.lax.cond(
                rounds <= LEARNING_ROUNDS,
                lambda: fit_family(found, own, done.fit.theta[:, None]),
                lambda: done.fit,
            )

        return one_round(done.state, learn, done.rounds + 1)

    last = jax.lax.while_loop(
        lambda done: (done.rounds < MAX_ROUNDS) & ~(done.moved_m < SETTLED_M),
        again,
        one_round(start, lambda found, _: fit_family(found, own, starts), jnp.array(1)),
    )
    fold = fold_of(observed, last.noise, last.state, last.solved, origin, table, last.rounds, last.moved_m)
    return Learned(fold, last.fit, model_weights(last.fit), last.found, own)


@functools.partial(jax.jit, static_argnames="options")
def learn_folds(
    chain: Chain,
    table: AnchorTable,
    prior: FamilyPriorArrays,
    use: Float[Array, "f k"],
    loss_width: Float[Array, ""],
    options: LearnOptions,
) -> tuple[Learned, EnsembleFold]:
    """Every row of `use` a fold, one after the other in one compiled program; and the first fold whole.

    The others' poses are not kept: they would be folds x poses large.
    """

    def one(first: tuple[Array, tuple], row: Float[Array, "k"]) -> tuple[tuple[Array, tuple], Learned]:
        learned = learn_fold(chain, table, prior, row, loss_width, options)
        whole = (learned.fold.observed, learned.fold.state)
        done, kept = first
        kept = jax.tree.map(lambda old, new: jnp.where(done, old, new), kept, whole)
        return (jnp.array(True), kept), _without_poses(learned)

    like = jax.eval_shape(lambda row: learn_fold(chain, table, prior, row, loss_width, options), use[0])
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), (like.fold.observed, like.fold.state))
    (_, whole), found = jax.lax.scan(one, (jnp.array(False), nothing), use)
    first = jax.tree.map(lambda x: x[0], found.fold)
    return found, eqx.tree_at(lambda f: (f.observed, f.state), first, whole, is_leaf=lambda x: x is None)


def _without_poses(learned: Learned) -> Learned:
    return eqx.tree_at(lambda x: (x.fold.observed, x.fold.state), learned, (None, None))


def ensemble_from(fit: ModelFit, prior: Prior, correlation_m: Array) -> NoiseEnsemble:
    """All models' draws, weighted by model and draw."""
    model = model_weights(fit)[:, None]
    # A model that was not found may hold NaN: without weight it must not reach a sum, as 0 x NaN is NaN.
    weight = jnp.where(model > 0, model * jnp.exp(fit.log_weight), 0.0)
    sigma = jnp.where((weight > 0)[..., None], jnp.exp(fit.draws) * prior.free[:, None], 0.0)
    return NoiseEnsemble(sigma.reshape(-1, N_COMPONENTS), weight.reshape(-1) / weight.sum(), correlation_m)
