"""The effect of the correction: agreement of revisits, and held-out errors, stage by stage."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eval.bootstrap import bootstrap_interval, mean
from eval.evaluation import STAGE_NAME, TrajectoryEvaluation
from eval.first_visits import FirstVisits
from eval.reference_study import EFFECT
from eval.tables.columns import (
    BESIDE_GROUP,
    PROVENANCE,
    SESSION,
    STAGE,
    TRAJECTORY,
    counts,
    length_unit_of,
    lengths,
    notes,
    provenance,
    provenance_of,
    shares,
    stats_of,
)
from jaxgeo.export.table import Table

# The reference study's stages: its similarity is of first visits, its correction has one noise for all trajectories.
_BESIDE = {"first": 0, "fixed": 1}
HELD_OUT_NOTE = (
    "Held out: each location in turn with all its visits; similarity, origin, noise and correction anew without it. "
    "Mean and RMS over visits, the interval of the mean by bootstrap over locations."
)
FIRST_NOTE = (
    "First visits: the similarity to each location's first visit, and only those scored, as in the reference study: "
    "with the second visit in, a gap of 101 m could not leave a mean of 13 m."
)
REVISIT_NOTE = (
    "Revisit: largest distance between two visits' markers of one location, with all anchors in (they pull the visits "
    "together) and held out (nothing does)."
)


def effect_table(evaluations: Sequence[TrajectoryEvaluation], beside: bool = False) -> Table:
    """A row for every trajectory and stage."""
    stats = [stats_of(e) for e in evaluations]
    unit = "cm" if beside else length_unit_of(s.mean_m for found in stats for s in found.values())
    columns = (
        SESSION,
        TRAJECTORY,
        STAGE,
        *lengths("revisit", "all in", "held out", unit=unit),
        *lengths("leave one location out", "mean", "low", "high", "RMS", unit=unit),
        *counts("", "failed"),
        *shares("", "in 95 %"),
        *(lengths(BESIDE_GROUP, "revisit", "mean", "RMS", unit=unit) if beside else ()),
        *PROVENANCE,
    )
    rows = []
    for evaluation, by_stage in zip(evaluations, stats, strict=True):
        if beside and evaluation.first is not None:
            rows.append(_first_row(evaluation, evaluation.first))
        for stage, found in by_stage.items():
            gaps = np.array(list(evaluation.revisit_m.get(stage, {}).values())).reshape(-1, 2)
            worst = gaps.max(axis=0) if len(gaps) else (np.nan, np.nan)
            per_location = np.array(list(found.per_location_m.values()))
            rows.append(
                (
                    evaluation.session,
                    evaluation.name,
                    STAGE_NAME[stage],
                    *worst,
                    found.mean_m,
                    *interval_of_mean(per_location, evaluation.seed),
                    found.rms_m,
                    found.n_failed,
                    found.coverage_95 if found.n_covariance else None,
                    *(_beside(evaluation, stage) if beside else ()),
                    *provenance(evaluation, stage),
                )
            )
    return Table(
        "effect",
        "Effect of the correction: agreement of revisits and held-out error",
        columns,
        tuple(rows),
        notes(evaluations, beside, REVISIT_NOTE, HELD_OUT_NOTE, *((FIRST_NOTE,) if beside else ())),
    )


def _first_row(evaluation: TrajectoryEvaluation, first: FirstVisits) -> tuple[Any, ...]:
    error_m = np.array(list(first.held_out_m.values()))
    known = error_m[np.isfinite(error_m)]
    return (
        evaluation.session,
        evaluation.name,
        STAGE_NAME["first"],
        max(first.revisit_m.values()),
        None,
        float(known.mean()) if len(known) else None,
        *interval_of_mean(error_m, evaluation.seed),
        float(np.sqrt(np.mean(known**2))) if len(known) else None,
        len(error_m) - len(known),
        None,
        *_beside(evaluation, "first"),
        *provenance_of([evaluation], str(len(error_m)), f"{len(known)} closed form", "none"),
    )


def interval_of_mean(value_m: np.ndarray, seed: int) -> tuple[float, float]:
    """95 % interval of a mean over locations; NaN of fewer than three."""
    known = value_m[np.isfinite(value_m)]
    return bootstrap_interval(known, mean, seed=seed) if len(known) > 2 else (np.nan, np.nan)


def _beside(evaluation: TrajectoryEvaluation, stage: str) -> tuple[float | None, ...]:
    if stage not in _BESIDE or (evaluation.session, evaluation.name) not in EFFECT:
        return (None,) * 3
    found, column = EFFECT[evaluation.session, evaluation.name], _BESIDE[stage]
    return found.revisit_m[column], found.loo_mean_m[column], found.loo_rms_m[column]
