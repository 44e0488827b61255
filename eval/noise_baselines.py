"""Held-out errors of one session under every way to its noise, side by side."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from calibration.baselines import PointFold, estimated_folds
from calibration.bilevel import bilevel_noise
from calibration.calibrate import LearnSettings, learn_options
from calibration.scale_factor import scale_factor_noise
from calibration.transfer import transferred_folds, true_noise_folds
from eval.loo import LeaveOneOut, correct_and_hold_out, learn_and_hold_out, without_each_location
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import ConvergenceError
from jaxgeo.export.held_out_stats import held_out_stats
from jaxgeo.export.result import HeldOut
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Settings


@dataclasses.dataclass(frozen=True)
class NoiseBaseline:
    """One way to the noise, judged by leaving one location out.

    Attributes:
        name: `similarity`, `fixed`, `scale factor`, `bilevel`, `transferred`, `learned` or `true`.
        mean_m, rms_m: held-out error over visits.
        coverage_50, coverage_95: share of visits inside their own ellipsoid; NaN where there is none (similarity).
        n_failed: visits whose fold is undetermined or did not settle; they are in none of the figures.
        held_out: every visit's error.
    """

    name: str
    mean_m: float
    rms_m: float
    coverage_50: float
    coverage_95: float
    n_failed: int
    held_out: HeldOut


def noise_baselines(
    trajectory: Trajectory,
    anchors: Anchors,
    settings: Settings,
    learn: LearnSettings,
    *,
    transferred: NoiseEnsemble | None = None,
    true: OdometryNoise | None = None,
) -> tuple[NoiseBaseline, ...]:
    """Every way on the same folds. `learn.noise` is the fixed noise.

    Args:
        transferred: what was learned on another session, its `Calibration.ensemble`.
        true: the noise that a simulated session was drawn from.

    Raises:
        UndeterminedError, ConvergenceError: of the correction with all anchors and the fixed noise.
    """
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    _, fixed = correct_and_hold_out(trajectory, anchors, learn.noise, settings)
    options, width = learn_options(settings, learn), jnp.asarray(settings.loss_width)
    folds = without_each_location(anchors)
    # An undetermined fold keeps all anchors: its answer is thrown away. As many rows as a bucket holds, as elsewhere.
    folds[anchors.location_index[~fixed.determined]] = 1.0
    rows = np.zeros((anchor_bucket(len(folds)), table.real.shape[0]))
    rows[:, : len(anchors)] = 1.0
    rows[: len(folds), : len(anchors)] = folds
    use = jnp.asarray(rows)

    ways: dict[str, Callable[[], PointFold]] = {
        "scale factor": lambda: estimated_folds(chain, table, learn.noise, use, width, options, scale_factor_noise),
        "bilevel": lambda: estimated_folds(chain, table, learn.noise, use, width, options, bilevel_noise),
    }
    if transferred is not None:
        ways["transferred"] = lambda: transferred_folds(chain, table, transferred, use, width, options.fold)
    held_out = {"similarity": fixed.coarse, "fixed": fixed.refined}
    held_out |= {name: _gather(way(), anchors, fixed) for name, way in ways.items()}
    held_out["learned"] = _learned(trajectory, anchors, settings, learn, fixed)
    if true is not None:
        held_out["true"] = _gather(true_noise_folds(chain, table, true, use, width, options.fold), anchors, fixed)
    return tuple(_row(name, anchors, found) for name, found in held_out.items())


def _learned(
    trajectory: Trajectory, anchors: Anchors, settings: Settings, learn: LearnSettings, fixed: LeaveOneOut
) -> HeldOut:
    """The learned noise's folds; all failed where learning with all anchors did not settle."""
    try:
        _, _, learned = learn_and_hold_out(trajectory, anchors, settings, learn, fixed)
    except ConvergenceError as error:
        k = len(anchors)
        return HeldOut(np.full((k, 3), np.nan), np.full((k, 3, 3), np.nan), (str(error),) * k)
    assert learned is not None  # folds were asked for
    return learned.refined


def _gather(found: PointFold, anchors: Anchors, fixed: LeaveOneOut) -> HeldOut:
    """Each visit's row from the fold of its own location; NaN where that fold means nothing."""
    found = jax.tree.map(np.asarray, found)
    fold, visit = anchors.location_index, np.arange(len(anchors))
    good = fixed.determined & found.settled[fold]
    error = found.point_m[fold, visit] - anchors.surveyed_enh_m
    result = tuple(
        words if not ok else "converged" if settled else f"not settled after {rounds} rounds"
        for words, ok, settled, rounds in zip(
            fixed.refined.result, fixed.determined, found.settled[fold], found.rounds[fold], strict=True
        )
    )
    return HeldOut(
        np.where(good[:, None], error, np.nan),
        np.where(good[:, None, None], found.error_covariance_m2[fold, visit], np.nan),
        result,
    )


def _row(name: str, anchors: Anchors, held_out: HeldOut) -> NoiseBaseline:
    stats = held_out_stats(anchors.location, held_out)
    return NoiseBaseline(
        name, stats.mean_m, stats.rms_m, stats.coverage_50, stats.coverage_95, stats.n_failed, held_out
    )
