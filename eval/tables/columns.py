"""What many tables share: columns of lengths and shares, and what a row was computed with."""

import collections
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from eval.evaluation import TrajectoryEvaluation
from jaxgeo.export.held_out_stats import HeldOutStats, held_out_stats
from jaxgeo.export.table import Column

SESSION = Column("session", align="left")
TRAJECTORY = Column("trajectory", align="left")
STAGE = Column("stage", align="left")
SIMULATED_NOTE = "Simulated sessions: these figures show the analysis at work, not how well real odometry is corrected."
BESIDE_GROUP = "reference study (recorded)"
BESIDE_NOTE = (
    "The last columns are what the reference study reports of its own recordings: different data, printed beside ours "
    "for orientation; nothing of it is reproduced here."
)
# Printed in no table but the CSV: what a row was computed with.
PROVENANCE = tuple(
    Column(head, align="left", csv_only=True) for head in ("anchors", "result", "noise", "seed", "versions")
)


def lengths(group: str, *heads: str, unit: str = "cm") -> tuple[Column, ...]:
    """Columns of lengths; rows hold metres. The unit stands once, with the group, where there is one."""
    factor, digits = {"cm": (100.0, 1), "m": (1.0, 2)}[unit]
    name, own = (f"{group} [{unit}]", "") if group else ("", unit)
    return tuple(Column(head, unit=own, group=name, digits=digits, factor=factor) for head in heads)


def length_beside(group: str, head: str) -> Column:
    """A length in centimetres in a group that holds other things too: the unit stands with it."""
    return Column(head, unit="cm", group=group, digits=1, factor=100.0)


def shares(group: str, *heads: str, digits: int = 0) -> tuple[Column, ...]:
    """Columns of shares, in percent."""
    return tuple(Column(head, unit="%", group=group, digits=digits, factor=100.0) for head in heads)


def counts(group: str, *heads: str) -> tuple[Column, ...]:
    return tuple(Column(head, group=group, digits=0) for head in heads)


def numbers(group: str, *heads: str, digits: int = 2) -> tuple[Column, ...]:
    return tuple(Column(head, group=group, digits=digits) for head in heads)


def length_unit_of(values_m: Iterable[float]) -> str:
    """Centimetres where the median value is below ten metres."""
    known = [v for v in values_m if np.isfinite(v)]
    return "cm" if not known or float(np.median(known)) < 10.0 else "m"


def stats_of(evaluation: TrajectoryEvaluation) -> dict[str, HeldOutStats]:
    """Leave-one-out statistics by stage."""
    return {s: held_out_stats(evaluation.anchors.location, h) for s, h in evaluation.held_out.items()}


def provenance(evaluation: TrajectoryEvaluation, stage: str) -> tuple[Any, ...]:
    """The values of `PROVENANCE` of a row about one trajectory's leave-one-out."""
    anchors = str(len(evaluation.anchors))
    return provenance_of([evaluation], anchors, results([evaluation], stage), noise_text(evaluation, stage))


def provenance_of(
    evaluations: Sequence[TrajectoryEvaluation], anchors: str, result: str, noise: str
) -> tuple[str, str, str, str, str]:
    """The same of a row about several, or about something else."""
    seeds = "; ".join(dict.fromkeys(str(e.seed) for e in evaluations))
    versions = " ".join(f"{name} {version}" for name, version in evaluations[0].versions.items())
    return anchors, result, noise, seeds, versions


def results(evaluations: Sequence[TrajectoryEvaluation], stage: str) -> str:
    """How the folds of a stage ended, counted over visits."""
    words = (word for e in evaluations if stage in e.held_out for word in e.held_out[stage].result)
    return "; ".join(f"{n} {word}" for word, n in collections.Counter(words).items())


def noise_text(evaluation: TrajectoryEvaluation, stage: str) -> str:
    """The noise values of a stage in one cell: fixed values, or the learned medians."""
    noise = evaluation.result.noise.get(stage)
    if noise is None:
        return {"coarse": "none", "true": "as simulated"}.get(stage, "")
    if stage == "learned":
        return "; ".join(f"{s['component']} {s['median']:.3g}" for s in noise["sigmas"])
    return "; ".join(f"{name} {_short(value)}" for name, value in noise.items())


def _short(value: Any) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "/".join(f"{v:.3g}" for v in dict.fromkeys(value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def notes(evaluations: Sequence[TrajectoryEvaluation], beside: bool, *more: str) -> tuple[str, ...]:
    """The notes of a table: its own, and what is to be said of all."""
    simulated = any(e.simulated for e in evaluations)
    return (*more, *((SIMULATED_NOTE,) if simulated else ()), *((BESIDE_NOTE,) if beside else ()))
