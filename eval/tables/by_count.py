"""Accuracy against the number of anchors: every choice of k locations, the others held out."""

import itertools
from collections.abc import Sequence

from eval.evaluation import STAGE_NAME, TrajectoryEvaluation
from eval.reference_study import BY_COUNT, BY_COUNT_NOTE
from eval.subsets import SubsetSummary, pooled_summary
from eval.tables.columns import (
    PROVENANCE,
    SESSION,
    STAGE,
    TRAJECTORY,
    counts,
    length_unit_of,
    lengths,
    noise_text,
    notes,
    provenance_of,
    shares,
)
from jaxgeo.export.table import Table

NOTE = (
    "In-sample: the anchors that were fitted to; held out: all visits of the other locations. Noise is learned anew "
    "for every choice of anchors. Failed: choices that do not fix the frame or did not settle; they are in no mean."
)
FIRST_NOTE = "First visits: only each location's first visit takes part; all other rows have every visit in."


def by_count_table(evaluations: Sequence[TrajectoryEvaluation], beside: bool = False) -> Table | None:
    """A row for every trajectory, stage and number of anchors; beside the study its sessions are pooled, as there."""
    groups = grouped(evaluations, pooled=beside)
    found = [(group, stage, s) for group in groups for stage in STAGE_NAME for s in summaries(groups[group], stage)]
    if not found:
        return None
    unit = "cm" if beside else length_unit_of(s.held_out_mean_m for _, _, s in found)
    columns = (
        *(() if beside else (SESSION,)),
        TRAJECTORY,
        STAGE,
        *counts("", "k", "choices", "failed"),
        *lengths("in-sample", "mean", "RMS", unit=unit),
        *lengths("held out", "mean", "RMS", unit=unit),
        *shares("", "in 95 %"),
        *(lengths("study: in-sample", "mean", "RMS", unit=unit) if beside else ()),
        *(lengths("study: held out", "mean", "RMS", unit=unit) if beside else ()),
        *PROVENANCE,
    )
    rows = [
        (
            *(group[1:] if beside else group),
            STAGE_NAME[stage],
            s.k,
            s.n_subsets,
            s.n_failed,
            s.in_sample_mean_m,
            s.in_sample_rms_m,
            s.held_out_mean_m,
            s.held_out_rms_m,
            s.coverage_95,
            *(_beside(group[1], stage, s.k) if beside else ()),
            *_provenance(groups[group], stage, s),
        )
        for group, stage, s in found
    ]
    said = [NOTE]
    if any(stage == "first" for _, stage, _ in found):
        said.append(FIRST_NOTE)
    if beside:
        said += ["The sessions are pooled, and first visits alone fitted, as in the reference study.", BY_COUNT_NOTE]
    return Table(
        "by_count",
        "Accuracy against the number of anchors k",
        columns,
        tuple(rows),
        notes(evaluations, beside, *said),
    )


def grouped(
    evaluations: Sequence[TrajectoryEvaluation], pooled: bool
) -> dict[tuple[str, str], list[TrajectoryEvaluation]]:
    """By (session, trajectory), or all sessions' trajectories of one name together."""
    groups: dict[tuple[str, str], list[TrajectoryEvaluation]] = {}
    for evaluation in evaluations:
        session = "+".join(dict.fromkeys(e.session for e in evaluations)) if pooled else evaluation.session
        groups.setdefault((session, evaluation.name), []).append(evaluation)
    return groups


def summaries(group: Sequence[TrajectoryEvaluation], stage: str) -> list[SubsetSummary]:
    """Of all numbers of anchors that every evaluation of the group has, most first; none where one lacks the stage."""
    if any(stage not in e.subsets for e in group):
        return []
    by_k = [{errors.k: errors for errors in e.subsets[stage]} for e in group]
    ks = [k for k in by_k[0] if all(k in other for other in by_k)]
    return [pooled_summary([found[k] for found in by_k]) for k in ks]


def _provenance(group: Sequence[TrajectoryEvaluation], stage: str, s: SubsetSummary) -> tuple[str, ...]:
    """Of the choices, not of the leave-one-out: learned noise is another for each of them."""
    noise = {"first": "none", "learned": "learned anew for every choice"}.get(stage)
    if noise is None:
        noise = " | ".join(dict.fromkeys(noise_text(e, stage) for e in group))
    ended = f"{s.n_subsets - s.n_failed} converged; {s.n_failed} failed"
    return provenance_of(group, f"those of {s.k} locations", ended, noise)


def _beside(trajectory: str, stage: str, k: int) -> tuple[float | None, ...]:
    found = BY_COUNT.get(trajectory, {}).get(k) if stage == "first" else None
    if found is None:
        return (None,) * 4
    return tuple(itertools.chain(found.in_sample_m, found.held_out_m or (None, None)))
