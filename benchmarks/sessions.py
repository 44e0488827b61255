"""Every real session from end to end: `python -m benchmarks.sessions [--json] [--markdown]`.

The data lie in `$JAXGEO_DATA`, else in `shared/data` beside the repository.
"""

import json
import math
import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import typer

from jaxgeo.cli.progress import Progress
from jaxgeo.cli.session import run_session
from jaxgeo.config import load_config
from jaxgeo.export.metrics import metrics_dict
from jaxgeo.precision import enable_compilation_cache

ROOT = Path(__file__).resolve().parents[1]
Row = dict[str, Any]


def rows_of(path: Path) -> list[Row]:
    """One row for each trajectory of a config; nothing of a simulated session; one row that says so where it failed."""
    started = time.perf_counter()
    try:
        config = load_config(path, [])
        if config.simulated:
            return []
        with Progress(quiet=True) as progress:
            metrics = metrics_dict(run_session(config, progress))
    except Exception as error:  # whatever it was: a session is never left out in silence
        return [failed_row(path.stem, f"{type(error).__name__}: {error}", time.perf_counter() - started)]
    seconds = time.perf_counter() - started
    return [
        row_of(metrics["session"], name, config.trajectories[name].odometry, found, seconds)
        for name, found in metrics["trajectories"].items()
    ]


def row_of(session: str, trajectory: str, odometry: str, found: dict[str, Any], seconds: float) -> Row:
    """A row from the trajectory's part of metrics.json; `seconds` is the whole session's, reading included."""

    def of(stage: str, group: str, key: str) -> float | None:
        return found[group][stage][key] if found[group][stage] is not None else None

    return {
        "session": session,
        "trajectory": trajectory,
        "odometry": odometry,
        "n_poses": found["n_poses"],
        "n_visits": found["n_visits"],
        "n_locations": found["n_locations"],
        "coarse_mean_m": of("coarse", "loo", "mean_m"),
        "fixed_mean_m": of("fixed", "loo", "mean_m"),
        "learned_mean_m": of("learned", "loo", "mean_m"),
        "coarse_rms_m": of("coarse", "loo", "rms_m"),
        "fixed_rms_m": of("fixed", "loo", "rms_m"),
        "learned_rms_m": of("learned", "loo", "rms_m"),
        "reference_coarse_rmse_m": of("coarse", "reference", "ate_rmse_m"),
        "reference_fixed_rmse_m": of("fixed", "reference", "ate_rmse_m"),
        "reference_learned_rmse_m": of("learned", "reference", "ate_rmse_m"),
        "coverage_50_fixed": of("fixed", "loo", "coverage_50"),
        "coverage_95_fixed": of("fixed", "loo", "coverage_95"),
        "coverage_50_learned": of("learned", "loo", "coverage_50"),
        "coverage_95_learned": of("learned", "loo", "coverage_95"),
        "n_failed": of("fixed", "loo", "n_failed"),
        "n_failed_learned": of("learned", "loo", "n_failed"),
        "result": found["solver"]["result"],
        "seconds": seconds,
    }


def failed_row(session: str, message: str, seconds: float) -> Row:
    """The same keys, all null but the session, what went wrong, and the time it took."""
    nothing = {"solver": {"result": f"FAILED: {message}"}} | dict.fromkeys(("n_poses", "n_visits", "n_locations"))
    stages = dict.fromkeys(("coarse", "fixed", "learned"))
    return row_of(session, "", "", nothing | {"loo": stages, "reference": stages}, seconds)


def ratio_of(row: Row, over: Iterable[str], stage: str) -> float | None:
    """Held-out mean error of a stage over the smallest of some others; None where one is missing."""
    errors = [row[f"{other}_mean_m"] for other in (*over, stage)]
    if any(error is None for error in errors):
        return None
    return errors[-1] / min(errors[:-1])


def geometric_mean_ratio(rows: Iterable[Row], stage: str = "fixed") -> float | None:
    """Geometric mean over trajectories of the held-out mean error, a stage over the one-time similarity."""
    logs = [math.log(ratio) for row in rows if (ratio := ratio_of(row, ["coarse"], stage)) is not None]
    return math.exp(math.fsum(logs) / len(logs)) if logs else None


# A row counts as no worse where the learned noise's error is at most this many times the better of the other two.
NO_WORSE = 1.05


def summary(rows: list[Row]) -> list[str]:
    """Sentences over all rows: what each noise gains over the similarity, and whether learning ever costs."""
    said = []
    for stage in ("fixed", "learned"):
        mean = geometric_mean_ratio(rows, stage)
        if mean is not None:
            said.append(f"Geometric mean of held-out mean error, {stage} noise over one-time similarity: {mean:.2f}.")
    ratios = {
        f"{row['session']} {row['trajectory']}".strip(): ratio
        for row in rows
        if (ratio := ratio_of(row, ["coarse", "fixed"], "learned")) is not None
    }
    if ratios:
        worst = max(ratios, key=lambda name: ratios[name])
        good = sum(ratio <= NO_WORSE for ratio in ratios.values())
        said.append(
            f"Learned noise at most {100 * (NO_WORSE - 1):.0f} % worse than the better of similarity and fixed noise: "
            f"{good} of {len(ratios)} rows; the worst ratio is {ratios[worst]:.2f} ({worst})."
        )
    return said


def length(*values_m: float | None) -> tuple[str, ...]:
    """Lengths of one comparison in one unit: centimetres where the largest is below a metre; a dash where none."""
    known = [v for v in values_m if v is not None]
    small = not known or max(known) < 1.0

    def text(value: float | None) -> str:
        if value is None:
            return "–"
        return f"{100 * value:.1f} cm" if small else f"{value:.2f} m"

    return tuple(map(text, values_m))


def share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.0f} %"


def markdown(rows: list[Row]) -> str:
    """The README's table: held-out mean errors, error against the reference where there is one, coverage."""
    head = (
        "session", "odometry", "poses", "visits / locations", "held out: similarity", "fixed noise", "learned",
        "ratio, fixed", "ratio, learned", "reference: similarity", "fixed noise", "learned",
        "in 50 / 95 % ellipsoid, fixed", "learned", "solver", "time",
    )  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---|---" + "|---:" * (len(head) - 3) + "|---:|"]
    for row in rows:
        if row["result"].startswith("FAILED"):
            message = row["result"].replace("|", "\\|").replace("\n", " ")
            lines.append(f"| {row['session']} | " + " | ".join([message, *["–"] * (len(head) - 2)]) + " |")
            continue
        failed = row["n_failed_learned"] or row["n_failed"]
        cells = (
            row["session"],
            row["odometry"],
            f"{row['n_poses']}",
            f"{row['n_visits']} / {row['n_locations']}",
            *held_out_lengths(row),
            *(number(geometric_mean_ratio([row], stage)) for stage in ("fixed", "learned")),
            *reference_lengths(row),
            *(coverage(row, stage) for stage in ("fixed", "learned")),
            row["result"] + (f", {failed} folds failed" if failed else ""),
            f"{row['seconds']:.1f} s",
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", *summary(rows)])


def held_out_lengths(row: Row) -> tuple[str, ...]:
    return length(row["coarse_mean_m"], row["fixed_mean_m"], row["learned_mean_m"])


def reference_lengths(row: Row) -> tuple[str, ...]:
    return length(row["reference_coarse_rmse_m"], row["reference_fixed_rmse_m"], row["reference_learned_rmse_m"])


def number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def coverage(row: Row, stage: str) -> str:
    return f"{share(row[f'coverage_50_{stage}'])} / {share(row[f'coverage_95_{stage}'])}"


def print_table(rows: list[Row]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(
        "session", "poses", "held out: similarity", "fixed", "learned", "reference", "50/95 %, fixed", "learned",
        "solver", "time",
    )  # fmt: skip
    for row in rows:
        table.add_row(
            f"{row['session']} {row['trajectory']}",
            str(row["n_poses"]),
            *held_out_lengths(row),
            " → ".join(reference_lengths(row)),
            *(coverage(row, stage) for stage in ("fixed", "learned")),
            row["result"],
            f"{row['seconds']:.1f} s",
        )
    Console().print(table)
    print("\n".join(summary(rows)))


def main(
    as_json: bool = typer.Option(False, "--json", help="A JSON array, one object a row."),
    as_markdown: bool = typer.Option(False, "--markdown", help="The table of the README."),
) -> None:
    os.environ.setdefault("JAXGEO_DATA", str(ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    rows = [row for path in sorted((ROOT / "configs").glob("*.yaml")) for row in rows_of(path)]
    if as_json:
        print(json.dumps(rows, allow_nan=False))
    elif as_markdown:
        print(markdown(rows))
    else:
        print_table(rows)


if __name__ == "__main__":
    typer.run(main)
