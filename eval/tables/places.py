"""Surveyed locations, and how well the sightings of each visit repeat."""

from collections.abc import Sequence

import numpy as np

from eval.evaluation import TrajectoryEvaluation
from eval.reference_study import REPEATABILITY
from eval.repeatability import repeatability
from eval.tables.columns import BESIDE_GROUP, SESSION, counts, length_beside, notes
from jaxgeo.export.table import Column, Table

_TEXT = Column("visit", align="left")
_LOCATION = Column("location", align="left")


def places_table(
    evaluations: Sequence[TrajectoryEvaluation], origin_enh_m: dict[str, np.ndarray], beside: bool = False
) -> Table:
    """A row for every visit of every session, and one of all its sightings; `origin_enh_m` by session.

    The scatter is composed along a trajectory: of several, the session's first.
    """
    first = {e.session: e for e in reversed(evaluations)}
    grid = tuple(Column(head, unit="m", group="surveyed", digits=3) for head in ("N", "E", "h"))
    columns = (
        SESSION,
        _TEXT,
        _LOCATION,
        *grid,
        *counts("sightings", "n"),
        length_beside("sightings", "RMS"),
        *((*counts(BESIDE_GROUP, "n"), length_beside(BESIDE_GROUP, "RMS")) if beside else ()),
    )
    rows = []
    for session in dict.fromkeys(e.session for e in evaluations):
        anchors = first[session].anchors
        study = REPEATABILITY.get(session, ()) if beside else ()
        in_grid = anchors.surveyed_enh_m + origin_enh_m[session]
        found = repeatability(anchors)
        values = [
            (visit.label, visit.location, *place, visit.count, visit.rms_m)
            for visit, place in zip(found.visits, in_grid[:, [1, 0, 2]].tolist(), strict=True)
        ]
        values.append(("all", "", None, None, None, found.count, found.rms_m))
        for i, value in enumerate(values):
            reported = study[i] if len(study) == len(values) else (None, None)
            rows.append((session, *value, *(reported if beside else ())))
    return Table(
        "locations",
        "Surveyed locations, and the scatter of each visit's sightings about their centroid",
        columns,
        tuple(rows),
        notes(evaluations, beside),
    )
