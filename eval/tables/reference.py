"""Errors against a reference trajectory: absolute (ATE), and drift over distances (RPE); Sturm et al. 2012."""

from collections.abc import Sequence

from eval.evaluation import STAGE_NAME, STAGES, TrajectoryEvaluation
from eval.tables.columns import (
    PROVENANCE,
    SESSION,
    STAGE,
    TRAJECTORY,
    counts,
    length_unit_of,
    lengths,
    notes,
    provenance,
)
from jaxgeo.export.table import Column, Table


def absolute_table(evaluations: Sequence[TrajectoryEvaluation]) -> Table | None:
    """ATE of every stage; None without a reference."""
    found = [(e, s, e.absolute[s]) for e in evaluations for s in STAGES if s in e.absolute]
    if not found:
        return None
    unit = length_unit_of(error.ate_rmse_m for *_, error in found)
    columns = (
        SESSION,
        TRAJECTORY,
        STAGE,
        *lengths("absolute error", "RMS", "median", unit=unit),
        *counts("", "poses"),
        Column("alignment", align="left"),
        *PROVENANCE,
    )
    rows = tuple(
        (
            e.session,
            e.name,
            STAGE_NAME[stage],
            error.ate_rmse_m,
            error.ate_median_m,
            error.n_poses,
            "one rigid fit" if error.aligned else "none",
            *provenance(e, stage),
        )
        for e, stage, error in found
    )
    title = "Absolute trajectory error against the reference"
    return Table("absolute", title, columns, rows, notes(evaluations, False))


def relative_table(evaluations: Sequence[TrajectoryEvaluation]) -> Table | None:
    """Drift over distances before and after the correction; None without a reference."""
    rows, values = [], []
    for e in evaluations:
        if not e.relative:
            continue
        for before, after in zip(e.relative["measured"], e.relative["corrected"], strict=True):
            if before.count == 0:
                continue
            values += [before.translation_rmse_m, after.translation_rmse_m]
            rows.append(
                (
                    e.session,
                    e.name,
                    before.distance_m,
                    before.count,
                    before.translation_rmse_m,
                    after.translation_rmse_m,
                    before.rotation_rmse_rad,
                    after.rotation_rmse_rad,
                    *provenance(e, "learned" if "learned" in e.held_out else "fixed"),
                )
            )
    if not rows:
        return None
    degrees = 57.29577951308232
    unit = length_unit_of(values)
    columns = (
        SESSION,
        TRAJECTORY,
        Column("over", unit="m", digits=0),
        *counts("", "pairs"),
        *lengths("translation RMS", "odometry", "corrected", unit=unit),
        *(Column(head, "deg", "rotation RMS", 2, factor=degrees) for head in ("odometry", "corrected")),
        *PROVENANCE,
    )
    note = "All pairs of poses that lie the distance apart along the reference, within a tenth; nothing is aligned."
    return Table(
        "relative", "Drift over distance against the reference", columns, tuple(rows), notes(evaluations, False, note)
    )
