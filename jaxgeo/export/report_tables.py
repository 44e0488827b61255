"""The tables of the report."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxgeo.export.held_out_stats import STAGES, HeldOutStats, final_stage, revisit_gap_m, stats_by_stage
from jaxgeo.export.number_words import MISSING, LengthColumn, decimal, length_words, number_text, percent
from jaxgeo.export.report_page import table
from jaxgeo.export.result import SessionResult, TrajectoryResult

STAGE_NAME = {"coarse": "one-time similarity", "fixed": "fixed noise", "learned": "learned noise"}


def comparison_table(result: SessionResult) -> str:
    """All trajectories of the session, one row each."""
    rows = []
    for name, t in result.trajectories.items():
        stats = stats_by_stage(t)
        means = [length_words(stats[s].mean_m) if s in stats else MISSING for s in STAGES]
        revisit = [
            worst_gap([gap["coarse_m"] for gap in t.revisit.values()]),
            worst_gap([revisit_gap_m(gap)[0] for gap in t.revisit.values()]),
        ]
        final = stats.get(final_stage(t))
        inside = percent(final.coverage_95) if final else MISSING
        rows.append(
            [
                name,
                f"{len(t.corrected)}",
                f"{len(t.anchors)}",
                *means,
                *revisit,
                inside,
                str(t.solver.get("result", MISSING)),
            ]
        )
    columns = [
        "Trajectory",
        "Poses",
        "Visits",
        *(STAGE_NAME[s] for s in STAGES),
        "before",
        "after",
        "in 95 %",
        "Solver",
    ]
    groups = [("", 3), ("Mean held-out error", 3), ("Largest revisit gap", 2), ("", 2)]
    return table("All trajectories of this session", columns, rows, groups=groups, text_columns=(0, 9))


def worst_gap(gaps_m: list[float]) -> str:
    return length_words(float(np.max(gaps_m))) if gaps_m else MISSING


def leave_one_out_table(trajectory: TrajectoryResult) -> str:
    """Held-out error by location and stage, with the solver's word on every fold."""
    stats = stats_by_stage(trajectory)
    location = trajectory.anchors.location
    show = LengthColumn(*(np.array(list(s.per_location_m.values())) for s in stats.values()))
    results = {s: dict(zip(location, trajectory.held_out[s].result, strict=True)) for s in stats}
    rows = [
        [
            name,
            f"{location.count(name)}",
            *(show(s.per_location_m[name]) for s in stats.values()),
            *(results[s][name] for s in stats if s != "coarse"),
        ]
        for name in dict.fromkeys(location)
    ]
    summary = {
        "Mean over visits": [s.mean_m for s in stats.values()],
        "RMS over visits": [s.rms_m for s in stats.values()],
        "Mean over locations": [s.mean_over_locations_m for s in stats.values()],
    }
    codes = [f"result, {STAGE_NAME[s]}" for s in stats if s != "coarse"]
    footer = [[title, "", *map(show, values), *("" for _ in codes)] for title, values in summary.items()]
    n = len(stats)
    return table(
        f"Leave one location out: mean error of its visits in {show.unit}",
        ["Location held out", "Visits", *(STAGE_NAME[s] for s in stats), *codes],
        rows,
        footer=footer,
        text_columns=(0, *range(2 + n, 2 + n + len(codes))),
    )


def revisit_table(trajectory: TrajectoryResult) -> str:
    """Distance between visits to one location."""
    show = LengthColumn(*(np.array(list(r.values()), dtype=float) for r in trajectory.revisit.values()))
    rows = [
        [name, show(r["coarse_m"]), show(r["refined_m"]), show(r.get("held_out_m", float("nan")))]
        for name, r in trajectory.revisit.items()
    ]
    caption = f"Largest distance between the marker positions that two visits to one location predict, in {show.unit}"
    columns = ["Location", STAGE_NAME["coarse"], "corrected, all anchors in", "corrected, location held out"]
    return table(caption, columns, rows)


def calibration_table(stats: dict[str, HeldOutStats]) -> str:
    """Are the predicted ellipsoids as large as the errors ask for?"""
    rows = [
        [
            STAGE_NAME[name],
            f"{s.n_covariance}",
            inside(s.coverage_50, s.n_covariance),
            inside(s.coverage_95, s.n_covariance),
            decimal(s.nees_mean, 2),
            f"{decimal(s.nees_band[0], 2)} … {decimal(s.nees_band[1], 2)}",
        ]
        for name, s in stats.items()
        if s.n_covariance
    ]
    columns = ["Stage", "Held-out visits", "inside 50 % ellipsoid", "inside 95 % ellipsoid", "mean NEES", "expected"]
    return table("Held-out errors against their predicted covariance", columns, rows)


def reference_table(trajectory: TrajectoryResult) -> str:
    """Absolute trajectory error against the reference trajectory."""
    reference = {s: trajectory.reference[s] for s in STAGES if s in trajectory.reference}
    show = LengthColumn(*(np.array([r.ate_rmse_m, r.ate_median_m]) for r in reference.values()))
    rows = [[STAGE_NAME[s], show(r.ate_rmse_m), show(r.ate_median_m), f"{r.n_poses}"] for s, r in reference.items()]
    fitted = any(error.aligned for error in trajectory.reference.values())
    how = "after one fit of the whole trajectory to it" if fitted else "in the same coordinates, nothing fitted"
    caption = f"Distance from the reference trajectory, {how}, in {show.unit}"
    return table(caption, ["Stage", "RMS", "median", "poses compared"], rows)


def flat_pairs(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """(dotted name, text) of every leaf of a nested dict."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat_pairs(inner, f"{path}.{key}" if path else str(key))
    else:
        yield path, number_text(value)


def inside(share: float, n: int) -> str:
    return f"{round(share * n)} of {n} ({percent(share)})"
