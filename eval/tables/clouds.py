"""How well two sessions' clouds agree, each georeferenced on its own."""

from collections.abc import Mapping, Sequence

from eval.clouds import CloudDistance
from eval.evaluation import STAGE_NAME, TrajectoryEvaluation
from eval.reference_study import CLOUDS
from eval.tables.columns import (
    BESIDE_GROUP,
    PROVENANCE,
    STAGE,
    TRAJECTORY,
    counts,
    length_beside,
    noise_text,
    notes,
    provenance_of,
    results,
    shares,
)
from jaxgeo.export.table import Table

_NOTE = (
    "From every point of the first session's cloud to the nearest of the second's. Each cloud moves with its own "
    "trajectory, which is georeferenced by itself; nothing is fitted between them."
)
_FLOOR = "Last row: both clouds carried by the true trajectories, what point spacing and range noise alone give."
# The study's clouds moved with its dense trajectories, corrected with one noise for all.
_BESIDE = ("dense", "fixed")


def clouds_table(
    found: Mapping[tuple[str, str], CloudDistance],
    floor: CloudDistance,
    sessions: Sequence[Mapping[str, TrajectoryEvaluation]],
    beside: bool = False,
) -> Table:
    """Rows by (trajectory, stage).

    Args:
        floor: the same sightings carried by the true trajectories.
        sessions: every session's evaluations by trajectory.
    """
    columns = (
        TRAJECTORY,
        STAGE,
        *counts("", "points"),
        *(length_beside("nearest neighbour", head) for head in ("mean", "median")),
        *shares("nearest neighbour", "within 30 cm", digits=1),
        *((length_beside(BESIDE_GROUP, head) for head in ("mean", "median")) if beside else ()),
        *(shares(BESIDE_GROUP, "within 30 cm", digits=1) if beside else ()),
        *PROVENANCE,
    )

    def distances(d: CloudDistance, reported: tuple[float | None, ...]) -> tuple[float | None, ...]:
        return d.n, d.mean_m, d.median_m, d.share_within_30cm, *(reported if beside else ())

    rows = [
        (
            trajectory,
            STAGE_NAME[stage],
            *distances(d, CLOUDS if (trajectory, stage) == _BESIDE else (None,) * 3),
            *_provenance([each[trajectory] for each in sessions], stage),
        )
        for (trajectory, stage), d in found.items()
    ]
    rows.append(("(true)", "truth", *distances(floor, (None,) * 3), *(None,) * len(PROVENANCE)))
    said = notes([e for each in sessions for e in each.values()], beside, _NOTE, _FLOOR)
    return Table("clouds", "Clouds of the two sessions against each other", columns, tuple(rows), said)


def _provenance(both: Sequence[TrajectoryEvaluation], stage: str) -> tuple[str, ...]:
    anchors = " + ".join(str(len(e.anchors)) for e in both)
    noise = " | ".join(dict.fromkeys(noise_text(e, stage) for e in both))
    return provenance_of(both, anchors, results(both, stage), noise)
