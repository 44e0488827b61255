"""The work on many sessions at once: one compiled program, sharded over a row of devices.

For every session: with all anchors, and without each location in turn, the one-time similarity, the fixed noise, the
noise learned anew, and the true noise. What leaves the device is what the study reads: held-out errors with their
covariances, and every model's posterior of the noise. Poses do not.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, Int

from calibration.calibrate import LearnSettings, learn_options
from calibration.learn import learn_fold
from eval.montecarlo.regimes import KIND
from eval.montecarlo.sessions import SessionArrays
from eval.montecarlo.settings import SOLVE
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.solve.ensemble_fold import solve_ensemble
from jaxgeo.solve.fold import solve_fold
from jaxgeo.solve.solver import succeeded

AXIS = "session"
STAGES: tuple[str, ...] = ("similarity", "fixed", "learned", "true")
# The choices that compile; every regime shares them, since all assume noise with a log-scale and without a bias.
_LEARN = learn_options(SOLVE, LearnSettings(KIND, default_noise(KIND)))
_FIXED = SOLVE.fold_options(default_noise(KIND))


class Posterior(eqx.Module):
    """What one choice of anchors says of the noise: every model's Laplace posterior of log sigma.

    Attributes:
        theta, converged, weight: of every model; the optimum, whether it was found, its weight.
        mean: (n,) of the prior, for this session's span.
        rounds: of learning and moving.
    """

    theta: Float[Array, "models n"]
    converged: Bool[Array, "models"]
    weight: Float[Array, "models"]
    mean: Float[Array, "n"]
    rounds: Int[Array, ""]


class SessionOutcome(eqx.Module):
    """What is kept of a session; stages as in `STAGES`, k visits.

    Attributes:
        error_m: held-out errors, predicted minus surveyed, east, north, height.
        covariance_m2: of them; NaN for the similarity, which predicts none.
        good: (stages, 1 + locations) whether the fold is determined and its solve converged.
        posterior: (1 + locations) from all anchors, then without each location.
        theta_covariance: (models, n, n) of the posterior from all anchors.
    """

    error_m: Float[Array, "s k 3"]
    covariance_m2: Float[Array, "s k 3 3"]
    good: Bool[Array, "s f"]
    posterior: Posterior
    theta_covariance: Float[Array, "models n n"]


def evaluate_session(session: SessionArrays) -> SessionOutcome:
    """One session, all folds one after the other."""
    chain, table = session.chain, session.table
    width = jnp.asarray(SOLVE.loss_width)

    def one(row: Float[Array, "k"]) -> tuple:
        fixed, _ = solve_fold(chain, table, session.assumed, row, width, _FIXED)
        learned = learn_fold(chain, table, session.family, row, width, _LEARN)
        true = solve_ensemble(chain, table, session.true, row, width, _LEARN.fold)
        point = jnp.stack([fixed.coarse_point_m, fixed.point_m, learned.fold.point_m, true.point_m])
        predicted = [fixed.error_covariance_m2, learned.fold.error_covariance_m2, true.error_covariance_m2]
        covariance = jnp.stack([jnp.full_like(predicted[0], jnp.nan), *predicted])
        good = fixed.determined & jnp.stack(
            [jnp.array(True), succeeded(fixed.solution.result), learned.fold.settled, true.settled]
        )
        fit = learned.fit
        posterior = Posterior(
            fit.theta, fit.converged, learned.model_weight, learned.prior.mean[0], learned.fold.rounds
        )
        return point, covariance, good, posterior, fit.covariance

    point, covariance, good, posterior, theta_covariance = jax.lax.map(one, session.use)
    # Every visit from the fold that held its location out; the table's padding has location -1, and is cut off later.
    fold, visit = 1 + table.location, jnp.arange(table.location.shape[0])
    return SessionOutcome(
        jnp.swapaxes(point[fold, :, visit] - table.surveyed_m[:, None], 0, 1),
        jnp.swapaxes(covariance[fold, :, visit], 0, 1),
        good.T,
        posterior,
        theta_covariance[0],
    )


def session_mesh(devices: list) -> Mesh:
    """A row of devices."""
    return jax.make_mesh((len(devices),), (AXIS,), axis_types=(jax.sharding.AxisType.Auto,), devices=devices)


def on_devices(sessions: SessionArrays, mesh: Mesh) -> SessionArrays:
    """Stacked sessions, spread over the devices; their number must divide by that of the devices."""
    return jax.device_put(sessions, NamedSharding(mesh, PartitionSpec(AXIS)))


@functools.partial(jax.jit, static_argnames=("mesh", "side_by_side"))
def evaluate_sessions(sessions: SessionArrays, mesh: Mesh, side_by_side: bool) -> SessionOutcome:
    """Every session on the leading axis; each device its own part, without a word to the others.

    Args:
        side_by_side: a device works on all of its sessions together, by `vmap`; else on one after the other.
    """

    def part(own: SessionArrays) -> SessionOutcome:
        return jax.vmap(evaluate_session)(own) if side_by_side else jax.lax.map(evaluate_session, own)

    spec = PartitionSpec(AXIS)
    return jax.shard_map(part, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False)(sessions)
