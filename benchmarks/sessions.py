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
        "reference_coarse_rmse_m": of("coarse", "reference", "ate_rmse_m"),
        "reference_fixed_rmse_m": of("fixed", "reference", "ate_rmse_m"),
        "coverage_50": of("fixed", "loo", "coverage_50"),
        "coverage_95": of("fixed", "loo", "coverage_95"),
        "n_failed": of("fixed", "loo", "n_failed"),
        "result": found["solver"]["result"],
        "seconds": seconds,
    }


def failed_row(session: str, message: str, seconds: float) -> Row:
    """The same keys, all null but the session, what went wrong, and the time it took."""
    nothing = {"solver": {"result": f"FAILED: {message}"}} | dict.fromkeys(("n_poses", "n_visits", "n_locations"))
    stages = dict.fromkeys(("coarse", "fixed", "learned"))
    return row_of(session, "", "", nothing | {"loo": stages, "reference": stages}, seconds)


def geometric_mean_ratio(rows: Iterable[Row]) -> float | None:
    """Geometric mean over trajectories of the held-out mean error, fixed noise over one-time similarity."""
    logs = [
        math.log(row["fixed_mean_m"] / row["coarse_mean_m"])
        for row in rows
        if row["fixed_mean_m"] is not None and row["coarse_mean_m"] is not None
    ]
    return math.exp(math.fsum(logs) / len(logs)) if logs else None


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
        "session", "odometry", "poses", "visits / locations", "held out: similarity", "fixed noise", "learned", "ratio",
        "reference: similarity", "fixed noise", "in 50 / 95 % ellipsoid", "solver", "time",
    )  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---|---" + "|---:" * (len(head) - 3) + "|---:|"]
    for row in rows:
        if row["result"].startswith("FAILED"):
            message = row["result"].replace("|", "\\|").replace("\n", " ")
            lines.append(f"| {row['session']} | " + " | ".join([message, *["–"] * (len(head) - 2)]) + " |")
            continue
        ratio = geometric_mean_ratio([row])
        failed = f", {row['n_failed']} folds failed" if row["n_failed"] else ""
        cells = (
            row["session"],
            row["odometry"],
            f"{row['n_poses']}",
            f"{row['n_visits']} / {row['n_locations']}",
            *length(row["coarse_mean_m"], row["fixed_mean_m"], row["learned_mean_m"]),
            "–" if ratio is None else f"{ratio:.2f}",
            *length(row["reference_coarse_rmse_m"], row["reference_fixed_rmse_m"]),
            f"{share(row['coverage_50'])} / {share(row['coverage_95'])}",
            row["result"] + failed,
            f"{row['seconds']:.1f} s",
        )
        lines.append("| " + " | ".join(cells) + " |")
    mean = geometric_mean_ratio(rows)
    if mean is not None:
        lines += ["", f"Geometric mean of held-out mean error, fixed noise over one-time similarity: {mean:.2f}."]
    return "\n".join(lines)


def print_table(rows: list[Row]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("session", "poses", "held out: similarity", "fixed noise", "reference", "50/95 %", "solver", "time")
    for row in rows:
        table.add_row(
            f"{row['session']} {row['trajectory']}",
            str(row["n_poses"]),
            *length(row["coarse_mean_m"], row["fixed_mean_m"]),
            " → ".join(length(row["reference_coarse_rmse_m"], row["reference_fixed_rmse_m"])),
            f"{share(row['coverage_50'])} / {share(row['coverage_95'])}",
            row["result"],
            f"{row['seconds']:.1f} s",
        )
    Console().print(table)
    mean = geometric_mean_ratio(rows)
    if mean is not None:
        print(f"geometric mean of held-out mean error, fixed noise over one-time similarity: {mean:.2f}")


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
