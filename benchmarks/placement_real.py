"""Do planned anchors help on real paths? Held out: every marker that was not chosen; the noise is learned throughout.

A plan sees no survey and no error: the odometry's own, drifting shape, the documented noise of its kind, and when each
candidate is passed. It is compared with the same number of anchors at equal spacing and with random choices.
"""

import dataclasses
import functools
import time
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import rankdata

from benchmarks.placement_paths import RealPath, default_sets, known_of, prior_sets, tag_path, truth_path, way_m
from eval.placement.candidates import CLOSED
from eval.placement.scored import Chosen, corrected_with, marker_error_m
from eval.placement.subset_search import best_choice, random_subsets, subset_values
from jaxgeo.data import Trajectory

# How a choice is judged: mean and RMS over the held-out visits, and RMSE of all poses where their truth is known.
MEASURES = ("held_out_mean_m", "held_out_rms_m", "path_rmse_m")


def real_rows(
    data: Path, counts: tuple[int, ...], random: int, seed: int, *, further: bool = False
) -> list[dict[str, Any]]:
    """One row for each path and number of anchors; `further` KITTI sequences too, which nobody asked for."""
    names = {"KITTI 00": "kitti00", "KAIST_01": "mulran_kaist01"}
    if further:
        names |= {"KITTI 05": "kitti05", "KITTI 06": "kitti06", "KITTI 07": "kitti07"}
    makes = [tag_path, *(functools.partial(truth_path, name, key, data) for name, key in names.items())]
    return [row for make in makes for row in rows_of(make(), counts, random, seed)]


def rows_of(path: RealPath, counts: tuple[int, ...], random: int, seed: int) -> list[dict[str, Any]]:
    """Planned, equal spacing and random choices of each number of anchors, side by side."""
    rows = []
    for count in counts:
        started = time.perf_counter()
        choices = choices_of(path, count, random, seed)
        masks = np.zeros((len(choices.rows), path.candidates), dtype=bool)
        np.put_along_axis(masks, choices.rows, True, axis=1)
        each = corrected_with(path.odometry, path.anchors, masks, path.settings, path.learn)
        found = [errors_of(path, mask, chosen) for mask, chosen in zip(masks, each, strict=True)]
        rows.append(row_of(path, choices, found) | {"seconds": time.perf_counter() - started})
    return rows


@dataclasses.dataclass(frozen=True)
class Choices:
    """Choices of one number of candidates: `names` of the first rows, the rest drawn; what the plan promises of each.

    Attributes:
        rows: (s, k) candidates.
        promised_m: (s,) by the plan along the odometry's own shape.
    """

    names: tuple[str, ...]
    rows: Int[np.ndarray, "s k"]
    promised_m: Float[np.ndarray, "s"]


def choices_of(path: RealPath, count: int, random: int, seed: int) -> Choices:
    """`planned` is what is asked about. Beside it a plan under every noise model of the learner's prior, for which the
    mean of their accuracies counts, and, where there is a truth, a plan that knows the path's true shape.
    """
    default = default_sets(path.kind)
    known = known_of(path, path.odometry, default)
    named = {"planned": best_choice(known, count)[0], "equal_spacing": equally_spaced(path, count)}
    under_prior = known_of(path, path.odometry, prior_sets(path), "mean")
    named["planned_under_prior"] = best_choice(under_prior, count)[0]
    if path.truth is not None:
        named["planned_on_true_shape"] = best_choice(known_of(path, path.truth, default), count)[0]
    rows = np.concatenate([np.array(list(named.values())), random_choices(path.candidates, count, random, seed)])
    return Choices(tuple(named), rows, subset_values(known, rows))


@dataclasses.dataclass(frozen=True)
class Errors:
    """Of one choice.

    Attributes:
        visit_m: (j,) of the judged visits; NaN where the choice used their location, infinite where it gave no path.
        path_rmse_m: of all poses; NaN without a truth, infinite without a path.
        failed: "", "undetermined" or "unsettled".
    """

    visit_m: Float[np.ndarray, "j"]
    path_rmse_m: float
    failed: str

    @property
    def measures(self) -> tuple[float, float, float]:
        """In the order of `MEASURES`."""
        error = self.visit_m[~np.isnan(self.visit_m)]
        return float(error.mean()), float(np.sqrt(np.mean(error**2))), self.path_rmse_m


def errors_of(path: RealPath, choice: Bool[np.ndarray, "n"], chosen: Chosen) -> Errors:
    """How a choice did by what it left out."""
    used = choice[path.anchors.location_index[path.judged]]
    if chosen.corrected is None:
        failed = "unsettled" if chosen.determined else "undetermined"
        return Errors(np.where(used, np.nan, np.inf), np.nan if path.truth is None else np.inf, failed)
    visit_m = marker_error_m(chosen.corrected, path.anchors)[path.judged]
    return Errors(np.where(used, np.nan, visit_m), path_rmse_m(chosen.corrected, path.truth), "")


def row_of(path: RealPath, choices: Choices, found: list[Errors]) -> dict[str, Any]:
    """One number of anchors: every named choice against the random ones; held-out mean errors first.

    `common_held_out_mean_m`: over the visits that neither the plan nor equal spacing used.
    """
    table = np.array([each.measures for each in found])
    drawn = slice(len(choices.names), None)
    names, promised = location_names(path), choices.promised_m
    rivals = [found[choices.names.index(name)].visit_m for name in ("planned", "equal_spacing")]
    common = ~np.isnan(rivals).any(axis=0)
    own = {
        name: {
            "anchors": [names[j] for j in choices.rows[i]],
            "visits": int(np.isin(path.anchors.location_index, choices.rows[i]).sum()),
            "promised_m": float(promised[i]),
            "promise_beats_random": float(np.mean(promised[i] < promised[drawn])),
        }
        | against(table[i], table[drawn])
        for i, name in enumerate(choices.names)
    }
    for name, visit_m in zip(("planned", "equal_spacing"), rivals, strict=True):
        own[name]["common_held_out_mean_m"] = finite(visit_m[common].mean())
    failed = [each.failed for each in found[drawn]]
    random = random_summary(promised[drawn], table[drawn])
    headline = MEASURES[0]
    return {
        "path": path.name,
        "anchors": choices.rows.shape[1],
        "planned_m": own["planned"][headline],
        "equal_spacing_m": own["equal_spacing"][headline],
        "random_median_m": random[headline]["median"],
        "candidates": path.candidates,
        "visits": len(path.anchors),
        "choices": own,
        "random": random | {word: failed.count(word) for word in ("undetermined", "unsettled")},
    }


def path_rmse_m(corrected: Trajectory, truth: Trajectory | None) -> float:
    """Over all poses; NaN without a truth."""
    if truth is None:
        return float("nan")
    return float(np.sqrt(np.mean(np.sum((corrected.position_m - truth.position_m) ** 2, axis=1))))


def against(own: Float[np.ndarray, "m"], random: Float[np.ndarray, "s m"]) -> dict[str, float | None]:
    """A choice's errors, and the share of random choices that it beats, by measure."""
    found = {}
    for measure, error, others in zip(MEASURES, own, random.T, strict=True):
        found[measure] = finite(error)
        found[f"{measure}_beats_random"] = None if np.isnan(error) else float(np.mean(error < others))
    return found


def random_summary(promised: Float[np.ndarray, "s"], random: Float[np.ndarray, "s m"]) -> dict[str, Any]:
    """Quartiles of the random choices, those without an answer the worst; and how well promises tell them.

    `log_scatter_about_promise`: standard deviation of log(error / promise): how far one session strays from it.
    """
    found: dict[str, Any] = {"choices": len(random)}
    for measure, error in zip(MEASURES, random.T, strict=True):
        if np.isnan(error).any():
            continue
        quartiles = [finite(q) for q in np.quantile(error, [0.25, 0.5, 0.75], method="higher")]
        found[measure] = dict(zip(("lower_quartile", "median", "upper_quartile"), quartiles, strict=True))
        found[measure] |= {
            "least": finite(error.min()),
            "rank_correlation_with_promise": rank_correlation(promised, error),
            "log_scatter_about_promise": finite(float(np.std(np.log(error / promised)[np.isfinite(error)]))),
        }
    return found


def rank_correlation(a: Float[np.ndarray, "s"], b: Float[np.ndarray, "s"]) -> float | None:
    """Spearman's; None where one side is all alike."""
    ranks = np.stack([rankdata(a), rankdata(b)])
    return float(np.corrcoef(ranks)[0, 1]) if (np.ptp(ranks, axis=1) > 0.0).all() else None


def finite(value: float) -> float | None:
    """JSON has no word for the rest."""
    return float(value) if np.isfinite(value) else None


def equally_spaced(path: RealPath, count: int) -> Int[np.ndarray, "k"]:
    """The candidates nearest to equal distances along the way: both ends and between, or round a closed path."""
    way, at = way_m(path.odometry.position_m), path.anchors.pose_index
    share = way[at] / way[-1]
    first, last = path.odometry.position_m[[0, -1]]
    closed = np.linalg.norm(last - first) < CLOSED * way[-1]
    taken: list[int] = []
    for wanted in np.arange(count) / count if closed else np.linspace(0.0, 1.0, count):
        away = np.abs(share - wanted)
        away = np.minimum(away, 1.0 - away) if closed else away
        away[np.isin(path.anchors.location_index, taken)] = np.inf
        taken.append(int(path.anchors.location_index[np.argmin(away)]))
    return np.sort(taken)


def random_choices(n: int, count: int, draws: int, seed: int) -> Int[np.ndarray, "s k"]:
    """Choices of `count` of n, each drawn without replacement."""
    random = np.random.default_rng([seed, n, count])
    return np.sort(random_subsets(n, count, draws, random), axis=1)


def location_names(path: RealPath) -> list[str]:
    """By `location_index`."""
    first = np.unique(path.anchors.location_index, return_index=True)[1]
    return [path.anchors.location[i] for i in first]
