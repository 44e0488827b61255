"""The findings on placement as tables, the study's own figures beside them, and in words."""

import itertools
from collections.abc import Iterator, Sequence

from eval.placement.findings import Findings, Spread
from eval.reference_study import BY_COUNT, CONTRAST
from jaxgeo.export.table import Column, Table

_NOTE = (
    "Simulated sessions of the reference study's layouts, corrected under the noise they were drawn from. Predicted: "
    "before anything is measured, with the 16 to 84 % range over choices. Achieved: with a 95 % bootstrap interval "
    "over sessions."
)


def findings_tables(found: Sequence[Findings]) -> list[Table]:
    """Number of anchors; near-collinear locations against the others; choices of four."""
    return [_counts(found), _geometry(found), _choices(found)]


def _counts(found: Sequence[Findings]) -> Table:
    return Table(
        name="placement_count",
        title="Placement (simulated): held-out error of the median choice of k anchors",
        columns=(
            *_WHICH,
            Column("k"),
            Column("choices"),
            Column("predicted", unit="cm", digits=1, factor=100.0),
            Column("16 to 84 % of choices", unit="cm", align="left"),
            Column("achieved", unit="cm", digits=1, factor=100.0),
            Column("95 %", unit="cm", align="left"),
            Column("reference study, RMS", unit="cm", digits=1, factor=100.0),
        ),
        rows=tuple(
            (
                *_which(each),
                row.k,
                row.choices,
                row.predicted.value,
                _range(row.predicted, 100.0, 1),
                row.achieved.value,
                _range(row.achieved, 100.0, 1),
                _reference_m(row.k),
            )
            for each in found
            for row in each.counts
        ),
        notes=(
            _NOTE,
            "The reference study's column: ICP odometry, real recordings, a similarity fit, RMS over all choices.",
        ),
    )


def _geometry(found: Sequence[Findings]) -> Table:
    return Table(
        name="placement_geometry",
        title="Placement (simulated): leave-one-out error of near-collinear locations and of the others",
        columns=(
            *_WHICH,
            Column("near-collinear", align="left"),
            *(
                Column(head, unit="cm", group=group, digits=1, factor=100.0)
                for group in ("predicted", "achieved")
                for head in ("near", "others")
            ),
            Column("predicted", group="ratio", digits=2),
            Column("achieved", group="ratio", digits=2),
            Column("95 %", group="ratio", align="left"),
        ),
        rows=tuple(
            (
                *_which(each),
                ", ".join(each.near),
                each.near_predicted_m,
                each.others_predicted_m,
                each.near_achieved_m.value,
                each.others_achieved_m.value,
                each.ratio_predicted,
                each.ratio_achieved.value,
                _range(each.ratio_achieved, 1.0, 2),
            )
            for each in found
        ),
        notes=(
            _NOTE,
            "The reference study's ratios, refined, of real recordings: "
            + ", ".join(f"{stages['refined'].near_m / stages['refined'].others_m:.2f}" for stages in CONTRAST.values())
            + ".",
        ),
    )


def _choices(found: Sequence[Findings]) -> Table:
    return Table(
        name="placement_choices",
        title="Placement (simulated): choices of four anchors, the best and the worst as predicted",
        columns=(
            *_WHICH,
            *(
                column
                for group in ("best as predicted", "worst as predicted")
                for column in (
                    Column("anchors", group=group, align="left"),
                    Column("predicted", unit="cm", group=group, digits=1, factor=100.0),
                    Column("achieved", unit="cm", group=group, digits=1, factor=100.0),
                )
            ),
            Column("rank correlation", digits=2),
            Column("95 %", align="left"),
        ),
        rows=tuple(
            (
                *_which(each),
                *(x for names, *values in (each.best, each.worst) for x in (" ".join(names), *values)),
                each.order.value,
                _range(each.order, 1.0, 2),
            )
            for each in found
        ),
        notes=("Rank correlation of predicted and achieved RMS over all choices of four.",),
    )


def findings_words(found: Sequence[Findings]) -> Iterator[str]:
    """What came true, counted."""
    n = len(found)
    falls = sum(_falls(each) for each in found)
    yield f"Simulated. More anchors, smaller achieved held-out error of the median choice: in {falls} of {n} cases."
    below = sum(each.ratio_achieved.high < 1.0 for each in found)
    yield (
        "Near-collinear locations have a smaller achieved leave-one-out error than the others, the whole 95 % interval "
        f"of the ratio below 1: in {below} of {n} cases; the ratio was predicted inside that interval in "
        f"{sum(each.ratio_achieved.low <= each.ratio_predicted <= each.ratio_achieved.high for each in found)}."
    )
    orders = [each.order.value for each in found]
    yield f"Predicted and achieved errors of choices of four: rank correlation {min(orders):.2f} to {max(orders):.2f}."
    failed = sum(each.failed for each in found)
    if failed:
        yield f"{failed} corrections did not settle and are left out."


def _reference_m(k: int) -> float | None:
    row = BY_COUNT["icp"].get(k)
    return None if row is None or row.held_out_m is None else row.held_out_m[1]


def _falls(each: Findings) -> bool:
    values = [row.achieved.value for row in each.counts]
    return all(later < earlier for earlier, later in itertools.pairwise(values))


_WHICH = (Column("layout", align="left"), Column("noise", align="left"), Column("sessions"))


def _which(each: Findings) -> tuple[str, str, int]:
    return each.layout, each.regime, each.sessions


def _range(spread: Spread, factor: float, digits: int) -> str:
    return f"{factor * spread.low:.{digits}f} to {factor * spread.high:.{digits}f}"
