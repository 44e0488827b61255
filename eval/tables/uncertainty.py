"""Was the predicted uncertainty right: coverage, normalised errors, predicted against achieved."""

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
    numbers,
    provenance,
    provenance_of,
    results,
    shares,
)
from eval.uncertainty import CalibrationRow, calibration_row, pooled_calibration
from jaxgeo.export.table import Table

_NOTE = (
    "Held-out visits in their own fold's predicted covariance, survey and sighting included. A ratio of achieved to "
    "predicted above 1: the errors are larger than was said. The band of the mean NEES is for independent locations; "
    "the folds of one session share its odometry, so that the true band is wider."
)


def uncertainty_table(evaluations: Sequence[TrajectoryEvaluation]) -> Table | None:
    """A row for every trajectory and stage with a covariance, and one of all trajectories together."""
    found: list[tuple[tuple[str, ...], tuple[str, ...], str, CalibrationRow]] = []
    for evaluation in evaluations:
        for stage, held_out in evaluation.held_out.items():
            row = calibration_row(stage, evaluation.anchors.location, held_out)
            if row.n:
                found.append((provenance(evaluation, stage), (evaluation.session, evaluation.name), stage, row))
    if len(evaluations) > 1:
        for stage in STAGES:
            pairs = [(e.anchors.location, e.held_out[stage]) for e in evaluations if stage in e.held_out]
            row = pooled_calibration(stage, pairs)
            if row.n and len(pairs) == len(evaluations):
                anchors = " + ".join(str(len(e.anchors)) for e in evaluations)
                made = provenance_of(evaluations, anchors, results(evaluations, stage), "each trajectory's own")
                found.append((made, ("all", "together"), stage, row))
    if not found:
        return None
    unit = length_unit_of(row.achieved_rms_m for *_, row in found)
    columns = (
        SESSION,
        TRAJECTORY,
        STAGE,
        *counts("held-out visits", "n", "failed"),
        *shares("inside ellipsoid of", "50 %", "95 %"),
        *numbers("NEES", "mean", "band low", "band high"),
        *lengths("RMS", "predicted", "achieved", unit=unit),
        *numbers("", "ratio"),
        *PROVENANCE,
    )
    rows = tuple(
        (
            *place,
            STAGE_NAME[stage],
            row.n,
            row.n_failed,
            row.coverage_50,
            row.coverage_95,
            row.nees_mean,
            *row.nees_band,
            row.predicted_rms_m,
            row.achieved_rms_m,
            row.achieved_over_predicted,
            *made,
        )
        for made, place, stage, row in found
    )
    title = "Predicted uncertainty against held-out errors"
    return Table("uncertainty", title, columns, rows, notes(evaluations, False, _NOTE))
