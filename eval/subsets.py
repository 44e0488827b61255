"""Accuracy against the number of anchors: every choice of k locations, estimated from them alone, judged on all.

Rows of a choice are its visits: of a location that is used all visits are (or the first only, where so asked), of one
that is not, none. All ways of estimating share the choices, the check of the frame and the gathering; a choice whose
anchors do not fix the frame, or which does not settle, is failed: it has no error, and is counted.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from calibration.calibrate import LearnSettings, learn_options
from calibration.learn import learn_folds, prior_arrays
from eval.similarity import fitted_markers, markers_of
from eval.subset_errors import SubsetErrors, SubsetSummary, gathered, pooled_summary, summary
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import InputError
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.bucket import anchor_bucket
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.graph.noise import OdometryNoise
from jaxgeo.solve.correct import Settings
from jaxgeo.solve.ensemble_fold import solve_ensemble
from jaxgeo.solve.fold import FOLD_BATCH, solve_folds
from jaxgeo.solve.solver import succeeded

__all__ = [
    "SubsetErrors",
    "SubsetSummary",
    "ensemble_subsets",
    "fixed_subsets",
    "learned_subsets",
    "location_subsets",
    "pooled_summary",
    "similarity_subsets",
    "summary",
]

Visits = Literal["all", "first"]
# Choices of one k beyond which they are drawn at random.
MOST = 2000


class _Predicted(NamedTuple):
    """What choices predict: markers, the covariance of their errors (NaN: none), and whether they mean anything."""

    point_m: Float[np.ndarray, "s k 3"]
    covariance_m2: Float[np.ndarray, "s k 3 3"]
    good: Bool[np.ndarray, "s"]


Predict = Callable[[Float[np.ndarray, "s k"]], _Predicted]


def location_subsets(n: int, k: int, most: int = MOST, seed: int = 0) -> Bool[np.ndarray, "s n"]:
    """All choices of k of n locations in lexicographic order; where there are more than `most`, that many at random.

    Random ones are drawn without repetition, every one as likely as another, and are in lexicographic order too.

    Raises:
        InputError: k is not between 1 and n, or `most` is not positive.
    """
    if not 1 <= k <= n or most < 1:
        raise InputError(f"choices of {k} of {n} locations, at most {most}: expected 1 <= k <= {n} and at least one.")
    if math.comb(n, k) <= most:
        chosen = list(itertools.combinations(range(n), k))
    else:
        random = np.random.default_rng([seed, n, k])
        drawn: set[tuple[int, ...]] = set()
        while len(drawn) < most:
            drawn.add(tuple(np.sort(random.choice(n, k, replace=False)).tolist()))
        chosen = sorted(drawn)
    used = np.zeros((len(chosen), n), dtype=bool)
    np.put_along_axis(used, np.array(chosen), True, axis=1)
    return used


def similarity_subsets(
    trajectory: Trajectory,
    anchors: Anchors,
    settings: Settings,
    ks: Sequence[int] | None = None,
    *,
    visits: Visits = "all",
    most: int = MOST,
    seed: int = 0,
) -> tuple[SubsetErrors, ...]:
    """The one-time similarity from every choice of k locations; it predicts no covariance.

    Args:
        ks: numbers of locations; default all of them, one fewer, ..., 3.
        visits: `first`: later visits of a location take no part, neither to fit nor to judge (one point a location).
    """
    markers = markers_of(trajectory, anchors, settings.extra_sigma_m, rotations=False)
    scale, gravity = settings.coarse_scale, settings.coarse_gravity

    def predict(use: Float[np.ndarray, "s k"]) -> _Predicted:
        point, good = fitted_markers(markers, use, scale=scale, gravity=gravity, of_graph=False)
        return _Predicted(point, np.full((*point.shape, 3), np.nan), good)

    return _subsets(anchors, ks, visits, most, seed, predict)


def fixed_subsets(
    trajectory: Trajectory,
    anchors: Anchors,
    noise: OdometryNoise,
    settings: Settings,
    ks: Sequence[int] | None = None,
    *,
    most: int = MOST,
    seed: int = 0,
) -> tuple[SubsetErrors, ...]:
    """The pose graph with a fixed noise, its coarse fit included, from every choice of k locations."""
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    options, width = settings.fold_options(noise), jnp.asarray(settings.loss_width)

    def solved(rows: Float[np.ndarray, "r k"]) -> _Predicted:
        found, _ = solve_folds(chain, table, noise, jnp.asarray(rows), width, options, FOLD_BATCH)
        good = np.asarray(found.determined) & np.asarray(succeeded(found.solution.result))
        return _Predicted(np.asarray(found.point_m), np.asarray(found.error_covariance_m2), good)

    return _subsets(anchors, ks, "all", most, seed, _in_chunks(anchors, solved))


def learned_subsets(
    trajectory: Trajectory,
    anchors: Anchors,
    settings: Settings,
    learn: LearnSettings,
    ks: Sequence[int] | None = None,
    *,
    most: int = MOST,
    seed: int = 0,
) -> tuple[SubsetErrors, ...]:
    """The noise learned anew from every choice of k locations, and the trajectory corrected with it."""
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    family, width = prior_arrays(learn.family), jnp.asarray(settings.loss_width)

    def solved(rows: Float[np.ndarray, "r k"]) -> _Predicted:
        found, _ = learn_folds(chain, table, family, jnp.asarray(rows), width, learn_options(settings, learn))
        fold = found.fold
        return _Predicted(*(np.asarray(x) for x in (fold.point_m, fold.error_covariance_m2, fold.settled)))

    predict = _only_determined(trajectory, anchors, settings, _in_chunks(anchors, solved))
    return _subsets(anchors, ks, "all", most, seed, predict)


def ensemble_subsets(
    trajectory: Trajectory,
    anchors: Anchors,
    settings: Settings,
    ensemble: NoiseEnsemble,
    ks: Sequence[int] | None = None,
    *,
    most: int = MOST,
    seed: int = 0,
) -> tuple[SubsetErrors, ...]:
    """The trajectory corrected under one given noise ensemble from every choice of k locations."""
    chain = chain_of(trajectory)
    table = anchor_table(anchors, chain, settings.extra_sigma_m)
    options, width = settings.ensemble_options(), jnp.asarray(settings.loss_width)
    padding = table.real.shape[0] - len(anchors)

    def solved(use: Float[np.ndarray, "s k"]) -> _Predicted:
        # One by one, through the program that leave-one-out under an ensemble has compiled.
        folds = [
            solve_ensemble(chain, table, ensemble, jnp.asarray(row), width, options)
            for row in np.pad(use, ((0, 0), (0, padding)))
        ]
        point, covariance, settled = (
            np.stack([np.asarray(getattr(fold, name)) for fold in folds])
            for name in ("point_m", "error_covariance_m2", "settled")
        )
        return _Predicted(point, covariance, settled)

    return _subsets(anchors, ks, "all", most, seed, _only_determined(trajectory, anchors, settings, solved))


def _subsets(
    anchors: Anchors, ks: Sequence[int] | None, visits: Visits, most: int, seed: int, predict: Predict
) -> tuple[SubsetErrors, ...]:
    """All choices of all ks as rows of one call, and their errors by k."""
    n, location = int(anchors.location_index.max()) + 1, anchors.location_index
    ks = range(n, 2, -1) if ks is None else ks
    takes_part = np.ones(len(anchors), dtype=bool)
    if visits == "first":
        takes_part[:] = False
        takes_part[np.unique(location, return_index=True)[1]] = True
    used = [location_subsets(n, k, most, seed) for k in ks]
    if not used:
        return ()
    use = np.concatenate(used)[:, location] & takes_part
    found = predict(use.astype(float))
    k = len(anchors)
    error_m = found.point_m[:, :k] - anchors.surveyed_enh_m
    covariance_m2 = found.covariance_m2[:, :k]
    ends = np.cumsum([len(rows) for rows in used])
    return tuple(
        gathered(size, math.comb(n, size), rows, use[part], takes_part, error_m[part], covariance_m2[part], good)
        for size, rows, part, good in (
            (size, rows, slice(end - len(rows), end), found.good[end - len(rows) : end])
            for size, rows, end in zip(ks, used, ends, strict=True)
        )
    )


def _in_chunks(anchors: Anchors, solved: Predict) -> Predict:
    """Solve as many rows at a time as leave-one-out has, the last ones filled up: its compiled program does them."""
    size = anchor_bucket(2 + int(anchors.location_index.max()))
    padding = anchor_bucket(len(anchors)) - len(anchors)

    def predict(use: Float[np.ndarray, "s k"]) -> _Predicted:
        rows = np.pad(use, ((0, -len(use) % size), (0, padding)), constant_values=((0, 1), (0, 0)))
        parts = [solved(part) for part in np.split(rows, len(rows) // size)]
        return _Predicted(*(np.concatenate(column)[: len(use)] for column in zip(*parts, strict=True)))

    return predict


def _only_determined(trajectory: Trajectory, anchors: Anchors, settings: Settings, solved: Predict) -> Predict:
    """Choices that do not fix the frame keep all anchors, since solving them means nothing, and are failed."""
    markers = markers_of(trajectory, anchors, settings.extra_sigma_m, rotations=settings.use_rotation)
    scale, gravity = settings.coarse_scale, settings.coarse_gravity

    def predict(use: Float[np.ndarray, "s k"]) -> _Predicted:
        _, good = fitted_markers(markers, use, scale=scale, gravity=gravity, of_graph=True)
        found = solved(np.where(good[:, None], use, 1.0))
        return found._replace(good=found.good & good)

    return predict
