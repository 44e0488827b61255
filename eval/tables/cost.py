"""What the computing costs: warm medians, which differ from run to run and from machine to machine."""

from collections.abc import Sequence

from eval.evaluation import TrajectoryEvaluation
from eval.reference_study import CORRECTION_S, DETECTION_S, LONGEST_POSES
from eval.tables.columns import SESSION, TRAJECTORY, counts
from jaxgeo.export.table import Column, Table


def cost_table(evaluations: Sequence[TrajectoryEvaluation], device: str, beside: bool = False) -> Table | None:
    """A row for every trajectory and stage that was timed."""
    rows = tuple(
        (e.session, e.name, len(e.result.measured), len(e.anchors), row.stage, row.what, row.seconds)
        for e in evaluations
        for row in e.cost
    )
    if not rows:
        return None
    columns = (
        SESSION,
        TRAJECTORY,
        *counts("", "poses", "anchors"),
        Column("stage", align="left"),
        Column("what", align="left"),
        Column("median", unit="ms", digits=1, factor=1e3),
    )
    low, high = (1e3 * s for s in CORRECTION_S)
    fast, slow = (1e3 * s for s in DETECTION_S)
    study = (
        f"The reference study: pose-graph correction {low:.1f} to {high:.1f} ms a session, its longest trajectory "
        f"{LONGEST_POSES} poses; marker detection {fast:.1f} to {slow:.1f} ms a frame (single thread, i9-12900H).",
    )
    return Table(
        "cost",
        "Cost of the computation",
        columns,
        rows,
        (f"Measured on {device}, warm: compiled before; median.", *(study if beside else ())),
    )
