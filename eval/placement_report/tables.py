"""The tables of a plan: layouts compared, numbers of anchors compared, anchors, what if, what limits the accuracy."""

import math

import numpy as np

from eval.placement.answer import PlacementAnswer
from eval.placement.criteria import CRITERIA
from eval.placement_report.report import PlacementReport, count_of, gain, layout_by, visits_by_anchor
from eval.placement_report.words import (
    METHOD,
    NOT_FIXED,
    better_words,
    by_kind,
    change_words,
    limit_name,
    what_if_words,
)
from jaxgeo.export.figure_style import length_unit
from jaxgeo.export.number_words import MISSING, grouped
from jaxgeo.export.table import Column, Table

HEADS = {"path": "along the path", "worst": "worst place", "D": "D", "E": "E"}


def layouts_table(answer: PlacementAnswer) -> Table:
    """Every layout by every criterion, best first."""
    known = [x for layout in answer.layouts for x in layout.accuracy_m.values() if math.isfinite(x)]
    factor, unit = length_unit(max(known, default=1.0))
    lengths = [Column(HEADS[c], unit, "Predicted, 1 sigma", 2 if unit != "mm" else 1, factor=factor) for c in CRITERIA]
    columns = (
        Column("Layout found by", align="left"),
        *lengths,
        Column("gain", "%", digits=1, factor=100.0),
        Column("time", "s", digits=1),
    )
    rows = [
        (
            METHOD[layout.method] + (" (chosen)" if layout is answer.chosen and len(answer.layouts) > 1 else ""),
            *(x if math.isfinite(x) else NOT_FIXED for x in (layout.accuracy_m[c] for c in CRITERIA)),
            gain(answer, layout),
            layout.seconds if layout.method not in ("given", "equal spacing") else math.nan,
        )
        for layout in answer.layouts
    ]
    notes = (
        "Along the path: root mean square of the position error, all axes. Worst place: the same at the least accurate "
        f"place. D: geometric mean of all axes of all error ellipsoids. E: their longest axis. Made small: "
        f"{HEADS[answer.criterion]}; gain: by how much smaller it is than with equal spacing.",
    )
    name = f"layouts-{count_of(answer.chosen)}"
    return Table(name, f"{count_of(answer.chosen)} anchors: layouts compared", columns, tuple(rows), notes)


def counts_table(report: PlacementReport) -> Table:
    """The chosen layout of every number of anchors."""
    answers = report.answers
    known = [x for a in answers for x in a.chosen.accuracy_m.values() if math.isfinite(x)]
    factor, unit = length_unit(max(known, default=1.0))
    digits = 2 if unit != "mm" else 1
    columns = (
        Column("Anchors to place"),
        Column("with those that stand"),
        *(Column(HEADS[c], unit, "Predicted, 1 sigma", digits, factor=factor) for c in ("path", "worst")),
        Column("equal spacing", unit, "", digits, factor=factor),
        Column("gain", "%", digits=1, factor=100.0),
    )
    rows = []
    for answer in answers:
        chosen, even = answer.chosen, layout_by(answer, "equal spacing")
        rows.append(
            (
                count_of(chosen),
                len(chosen.name),
                chosen.accuracy_m["path"],
                chosen.accuracy_m["worst"],
                math.nan if even is None else even.accuracy_m[answer.criterion],
                gain(answer, chosen),
            )
        )
    notes = (f"Gain: by how much smaller the criterion ({HEADS[answers[0].criterion]}) is than with equal spacing.",)
    return Table("counts", "Numbers of anchors compared", columns, tuple(rows), notes)


def anchors_table(report: PlacementReport, answer: PlacementAnswer) -> Table:
    """The chosen anchors, where the path passes them, and what moving them would cost."""
    chosen, passed = answer.chosen, visits_by_anchor(answer.chosen)
    grid = report.frame.to_grid(chosen.point_m)
    slope = 100.0 * answer.sensitivity.position_per_m
    columns = (
        Column("Anchor", align="left"),
        Column("", align="left"),
        *(Column(axis, "m", "Coordinates") for axis in "ENh"),
        Column("passed at", "m along the path", align="left"),
        Column("east", "%", "Error, if moved by 1 m", 1),
        Column("north", "%", "Error, if moved by 1 m", 1),
    )
    rows = [
        (
            name,
            "given" if report.predicted else "stands" if stands else "to be placed",
            *(grouped(float(x), 3) for x in point),
            ", ".join(f"{x:.0f}" for x in passed[name]) or f"{MISSING} (not seen)",
            *(float(x) for x in across),
        )
        for name, stands, point, across in zip(chosen.name, chosen.standing, grid, slope, strict=True)
    ]
    notes = (
        "Passed at: distances along the path at which the anchor is seen from nearest; passes close together are one "
        "visit. Moved by 1 m: first-order change of the criterion; near 0 at a best place that nothing bounds.",
    )
    return Table("anchors", "Where the anchors stand", columns, tuple(rows), notes)


def what_if_table(report: PlacementReport, answer: PlacementAnswer) -> Table:
    """Every single change and what it does to the criterion."""
    before = answer.chosen.accuracy_m[answer.criterion]
    columns = (Column("Change", align="left"), Column("accuracy", align="left"), Column("which is", align="left"))
    rows = tuple(
        (
            what_if_words(change, report.frame),
            change_words(before, change.accuracy_m),
            better_words(before, change.accuracy_m),
        )
        for change in answer.what_if
    )
    return Table("what-if", f"What if: {HEADS[answer.criterion]}, 1 sigma, after one change", columns, rows)


def limits_table(answer: PlacementAnswer) -> Table:
    """What the accuracy depends on, most first."""
    found = {"survey": answer.sensitivity.survey_sigma, "sighting": answer.sensitivity.sighting_sigma}
    noise = answer.sensitivity.noise
    found |= {kind: sum(noise[name] for name in names) for kind, names in by_kind(noise).items()}
    order = sorted(found, key=lambda name: -abs(found[name]))
    columns = (
        Column("Were this 10 % smaller", align="left"),
        Column("the criterion would be smaller by", "%", digits=1),
    )
    rows = tuple((limit_name(name), 10.0 * found[name]) for name in order)
    notes = ("To first order. Sums to 10: the predicted error grows as all of its sources together.",)
    return Table("limits", "What limits the accuracy", columns, rows, notes if _all_there(found) else ())


def _all_there(found: dict[str, float]) -> bool:
    """The criterion is homogeneous of degree one in all sigmas."""
    return bool(np.isclose(sum(found.values()), 1.0, atol=0.02))
