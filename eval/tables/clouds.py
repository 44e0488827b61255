"""How well two sessions' clouds agree, each georeferenced on its own."""

from collections.abc import Mapping

from eval.clouds import CloudDistance
from eval.reference_study import CLOUDS
from eval.tables.columns import BESIDE_GROUP, BESIDE_NOTE, SIMULATED_NOTE, counts, length_beside, shares
from jaxgeo.export.table import Column, Table

_NOTE = (
    "From every point of the first session's cloud to the nearest of the second's. Each cloud moves with its own "
    "trajectory, which is georeferenced by itself; nothing is fitted between them."
)


def clouds_table(found: Mapping[tuple[str, str], CloudDistance], floor: CloudDistance, beside: bool = False) -> Table:
    """Rows by (trajectory, stage); `floor`: the same sightings carried by the true trajectories."""
    columns = (
        Column("trajectory", align="left"),
        Column("stage", align="left"),
        *counts("", "points"),
        *(length_beside("nearest neighbour", head) for head in ("mean", "median")),
        *shares("nearest neighbour", "within 30 cm", digits=1),
        *((length_beside(BESIDE_GROUP, head) for head in ("mean", "median")) if beside else ()),
        *(shares(BESIDE_GROUP, "within 30 cm", digits=1) if beside else ()),
    )
    study = {("dense", "fixed noise"): CLOUDS} if beside else {}
    rows = [
        (*key, d.n, d.mean_m, d.median_m, d.share_within_30cm, *(study.get(key, (None,) * 3) if beside else ()))
        for key, d in {**found, ("(true)", "truth"): floor}.items()
    ]
    note = "Last row: both clouds carried by the true trajectories, what point spacing and range noise alone give."
    return Table(
        "clouds",
        "Clouds of the two sessions against each other",
        columns,
        tuple(rows),
        (_NOTE, note, SIMULATED_NOTE, *((BESIDE_NOTE,) if beside else ())),
    )
