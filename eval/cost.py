"""What each stage costs on one trajectory, warm: medians of wall-clock times, compiled programs ready.

Only the programs that holding out has compiled already are run; they solve a fixed number of rows in one call, so that
one row's time is a share of that call's.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from calibration.calibrate import LearnSettings, learn_options
from calibration.learn import learn_folds, prior_arrays
from eval.loo import without_each_location
from eval.similarity import markers_of
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.geometry import umeyama
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Settings, correct_with_folds
from jaxgeo.solve.fold import FOLD_BATCH, solve_folds


@dataclasses.dataclass(frozen=True)
class CostRow:
    """One stage: its name, median seconds, and what was timed."""

    stage: str
    seconds: float
    what: str


def trajectory_cost(
    trajectory: Trajectory,
    anchors: Anchors,
    noise: OdometryNoise,
    settings: Settings,
    learn: LearnSettings | None,
    repetitions: int = 3,
) -> tuple[CostRow, ...]:
    """Coarse fit, correction, learning, and all leave-one-out folds with fixed and, unless None, with learned noise.

    Raises:
        UndeterminedError, ConvergenceError: of the correction with all anchors.
    """
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    folds = without_each_location(anchors)
    n, size, padding = len(folds), anchor_bucket(1 + len(folds)), table.real.shape[0] - len(anchors)
    width, options = jnp.asarray(settings.loss_width), settings.fold_options(noise)

    def rows_of(use: Float[np.ndarray, "f k"]) -> jax.Array:
        """Filled up with rows of all anchors."""
        return jnp.asarray(np.pad(use, ((0, size - len(use)), (0, padding)), constant_values=((0, 1), (0, 0))))

    def solved(rows: jax.Array) -> Any:
        return solve_folds(chain, table, noise, rows, width, options, FOLD_BATCH)[0]

    whole, held_out = rows_of(folds[:0]), rows_of(folds)
    markers = markers_of(trajectory, anchors, settings.extra_sigma_m, rotations=False)
    scale, gravity = settings.coarse_scale, settings.coarse_gravity
    timed: list[Callable[[], Any]] = [
        lambda: umeyama(markers.map_m, markers.surveyed_m, table.real, scale=scale, gravity=gravity),
        lambda: correct_with_folds(trajectory, anchors, noise, settings, folds)[0].covariance,
        lambda: solved(whole),
        lambda: solved(held_out),
    ]
    if learn is not None:
        family, learning = prior_arrays(learn.family), learn_options(settings, learn)
        # Undetermined folds keep all anchors, as where they are held out.
        determined = np.asarray(solved(held_out).determined)[:n]
        learned_out = rows_of(np.where(determined[:, None], folds, 1.0))
        timed += [
            lambda: learn_folds(chain, table, family, whole, width, learning)[0],
            lambda: learn_folds(chain, table, family, learned_out, width, learning)[0],
        ]
    seconds = times_s(repetitions, *timed).T
    fit_s, call_s, whole_s, folds_s = seconds[:4]
    poses = f"{len(trajectory)} poses, {len(anchors)} visits"
    rows = [
        ("coarse fit", fit_s, f"similarity to {len(anchors)} visits"),
        # The call solves the folds too: they are taken off, but for one row.
        ("correction", call_s - folds_s + whole_s / size, f"fixed noise, solve and covariance of every pose: {poses}"),
        ("solve", whole_s / size, f"of the correction, the solve alone: one of {size} in one call"),
        ("hold out, fixed noise", _only(n, size, folds_s, whole_s), f"{n} of {size} folds in one call"),
    ]
    if learn is not None:
        learn_s, learned_s = seconds[4:]
        rows += [
            ("learn the noise", learn_s / size, f"learn and correct with all anchors: one of {size} in one call"),
            (
                "hold out, learned noise",
                _only(n, size, learned_s, learn_s),
                f"{n} of {size} folds in one call, each learns anew",
            ),
        ]
    return tuple(CostRow(stage, float(np.median(s)), what) for stage, s, what in rows)


def _only(n: int, size: int, mixed_s: np.ndarray, whole_s: np.ndarray) -> np.ndarray:
    """Of a call with n folds, the rest filled up with rows of all anchors: the folds alone."""
    return mixed_s - (size - n) * whole_s / size


def once_s(function: Callable[[], Any]) -> float:
    """Seconds of one call, its arrays ready."""
    start = time.perf_counter()
    jax.block_until_ready(function())
    return time.perf_counter() - start


def times_s(repetitions: int, *functions: Callable[[], Any]) -> Float[np.ndarray, "repetitions functions"]:
    """Seconds of each function: one call each to warm up, then all in turn, again and again.

    On a shared machine all of them then see the same neighbours.
    """
    for function in functions:
        once_s(function)
    return np.array([[once_s(function) for function in functions] for _ in range(repetitions)])
