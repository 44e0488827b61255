"""Anchors near the line of their neighbours: the geometry, and whether they are predicted better than the others."""

from collections.abc import Sequence

import numpy as np

from eval.collinearity import Neighbours, collinearity_contrast, near_collinear, neighbours
from eval.evaluation import STAGE_NAME, TrajectoryEvaluation
from eval.reference_study import CONTRAST, CONTRAST_NOTE, NEAR_COLLINEAR, OTHERS_FROM_LINE_M
from eval.tables.columns import (
    BESIDE_GROUP,
    PROVENANCE,
    SESSION,
    STAGE,
    TRAJECTORY,
    length_beside,
    length_unit_of,
    lengths,
    notes,
    numbers,
    provenance,
    stats_of,
)
from jaxgeo.export.table import Column, Table

_BESIDE = {"coarse": "coarse", "fixed": "refined"}


def geometry_of(evaluation: TrajectoryEvaluation) -> tuple[Neighbours, ...]:
    """The session's locations in the order of their first visits."""
    anchors = evaluation.anchors
    first = [anchors.location.index(name) for name in dict.fromkeys(anchors.location)]
    return neighbours([anchors.location[i] for i in first], anchors.surveyed_enh_m[first])


def geometry_table(evaluations: Sequence[TrajectoryEvaluation], beside: bool = False) -> Table | None:
    """How far each location lies from the line of its two neighbours; one row for locations that sessions share."""
    rows: dict[tuple, None] = {}
    for evaluation in evaluations:
        for each in geometry_of(evaluation):
            share, distance = NEAR_COLLINEAR.get(each.name, (None, None))[::-1]
            extra = (distance, share) if beside else ()
            session = () if beside else (evaluation.session,)
            rows[(*session, each.name, f"{each.before}–{each.after}", each.distance_m, each.share, *extra)] = None
    if not rows:
        return None
    percent = Column("of the line", unit="%", digits=2, factor=100.0)
    columns = (
        *(() if beside else (SESSION,)),
        Column("location", align="left"),
        Column("neighbours", align="left"),
        *lengths("", "from their line"),
        percent,
        *((length_beside(BESIDE_GROUP, "from their line"), Column("of the line", "%", BESIDE_GROUP, 2, factor=100.0))
          if beside else ()),
    )  # fmt: skip
    low, high = (100.0 * x for x in OTHERS_FROM_LINE_M)
    said = (f"The reference study gives {low:.0f} to {high:.0f} cm for the others.",) if beside else ()
    note = "In space, horizontal and vertical together; from the coordinates alone."
    return Table(
        "geometry", "Distance of each location from the line of its two neighbours", columns, tuple(rows), (note, *said)
    )


def contrast_table(evaluations: Sequence[TrajectoryEvaluation], beside: bool = False) -> Table | None:
    """Mean held-out error of near-collinear locations against the others; None where no session has both."""
    rows, values = [], []
    for evaluation in evaluations:
        near = near_collinear(geometry_of(evaluation))
        for stage, found in stats_of(evaluation).items():
            contrast = collinearity_contrast(found.per_location_m, near)
            if not near or not np.isfinite(contrast.ratio):
                continue
            values += [contrast.near_mean_m, contrast.others_mean_m]
            rows.append(
                (
                    evaluation.session,
                    evaluation.name,
                    STAGE_NAME[stage],
                    ", ".join(sorted(near)),
                    contrast.near_mean_m,
                    contrast.others_mean_m,
                    contrast.ratio,
                    *(_contrast_beside(evaluation, stage) if beside else ()),
                    *provenance(evaluation, stage),
                )
            )
    if not rows:
        return None
    unit = "cm" if beside else length_unit_of(values)
    columns = (
        SESSION,
        TRAJECTORY,
        STAGE,
        Column("near-collinear", align="left"),
        *lengths("mean held-out error", "near-collinear", "others", unit=unit),
        *numbers("", "ratio"),
        *(lengths(BESIDE_GROUP, "near", "others", unit=unit) if beside else ()),
        *(numbers("", "study's ratio") if beside else ()),
        *PROVENANCE,
    )
    own = "Near-collinear: less than a tenth of the distance between its two neighbours away from their line."
    return Table(
        "collinearity",
        "Near-collinear locations against the others, leave one location out",
        columns,
        tuple(rows),
        notes(evaluations, beside, own, *((CONTRAST_NOTE,) if beside else ())),
    )


def _contrast_beside(evaluation: TrajectoryEvaluation, stage: str) -> tuple[float | None, ...]:
    found = CONTRAST.get((evaluation.session, evaluation.name), {}).get(_BESIDE.get(stage, ""))
    return (None,) * 3 if found is None else (found.near_m, found.others_m, found.near_m / found.others_m)
