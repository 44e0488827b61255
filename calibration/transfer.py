"""Noise that was not learned here: of another session of the platform, or known because the session was simulated."""

import functools

import jax
from jaxtyping import Array, Float

from calibration.baselines import PointFold, points_of
from jaxgeo.graph.anchor_table import AnchorTable
from jaxgeo.graph.chain import Chain
from jaxgeo.graph.components import NoiseEnsemble, ensemble_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.ensemble_fold import solve_ensemble
from jaxgeo.solve.fold import FoldOptions


@functools.partial(jax.jit, static_argnames="options")
def transferred_folds(
    chain: Chain,
    table: AnchorTable,
    ensemble: NoiseEnsemble,
    use: Float[Array, "f k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
) -> PointFold:
    """Every row of `use` a fold under the same ensemble, one after the other in one compiled program.

    `ensemble` is another session's `Calibration.ensemble`; its correlation length goes with it;
    `options.terms.log_scale` must be on.
    """

    def one(row: Float[Array, "k"]) -> PointFold:
        return points_of(solve_ensemble(chain, table, ensemble, row, loss_width, options))

    return jax.lax.map(one, use)


def true_noise_folds(
    chain: Chain,
    table: AnchorTable,
    true: OdometryNoise,
    use: Float[Array, "f k"],
    loss_width: Float[Array, ""],
    options: FoldOptions,
) -> PointFold:
    """The same with the noise that a simulated session was drawn from: what perfect knowledge would give."""
    return transferred_folds(chain, table, ensemble_of(true), use, loss_width, options)
