"""What `benchmarks.placement` measured, as tables for a reader."""

from typing import Any

from rich.console import Console
from rich.table import Table

CHOICES = {
    "planned": "planned",
    "planned_under_prior": "planned, prior noise",
    "planned_on_true_shape": "planned, true shape",
    "equal_spacing": "equal spacing",
}


def print_tables(found: dict[str, Any]) -> None:
    """Every part that was measured."""
    console = Console()
    tables = {"simulated": simulated_table, "shapes": shapes_table, "real": real_table, "speed": speed_table}
    for part, table in tables.items():
        if found[part] is not None:
            console.print(table(found[part]))
    for part, seconds in found["seconds"].items():
        print(f"{part}: {seconds:.0f} s")
    print(f"load average {found['load_average'][0]:.1f}, seed {found['seed']}")


def simulated_table(part: dict[str, Any]) -> Table:
    """Promised over achieved RMS along the path."""
    table = Table(
        "regime", "sessions", "promised", "achieved, true noise", "promised / achieved", "achieved, learned",
        "promised / achieved", "failed",
        title=f"SIMULATED sessions, layout {part['layout']}",
    )  # fmt: skip
    for name, row in (*part["regimes"].items(), ("all", {"sessions": part["sessions"]} | part["all"])):
        cells = [f"{row['promised_rms_m']:.3f} m"]
        for stage in ("true_noise", "learned_noise"):
            own = row[stage]
            low, high = own["interval_95"]
            ratio = f"{own['predicted_over_achieved']:.2f} [{low:.2f}, {high:.2f}]"
            cells += [f"{own['achieved_rms_m']:.3f} m", ratio]
        failed = row["true_noise"]["failed"] + row["learned_noise"]["failed"]
        table.add_row(name, str(row["sessions"]), *cells, str(failed))
    return table


def shapes_table(part: dict[str, Any]) -> Table:
    """Accuracy that each way to place markers promises."""
    table = Table(
        "shape", "anchors", "gradient", "exhaustive (grid)", "gap", "greedy", "exchange", "equal spacing",
        title=f"Largest gap {percent(part['gap_to_exhaustive'])}, to the best of all "
        f"{percent(part['gap_to_best_known'])}; gradients against differences {part['gradient_difference']:.1e}",
    )  # fmt: skip
    for row in part["rows"]:
        grids = ", ".join(f"{1000 * value:.1f} ({grid})" for grid, value in row["exhaustive_m"].items())
        cells = [millimetres(row[f"{way}_m"]) for way in ("greedy", "exchange", "equal_spacing")]
        gap = percent(row["gap_to_exhaustive"])
        table.add_row(row["shape"], str(row["anchors"]), millimetres(row["gradient_m"]), grids, gap, *cells)
    return table


def real_table(part: list[dict[str, Any]]) -> Table:
    """Held-out mean error, and the share of random choices with a larger one; RMSE of all poses below it."""
    table = Table(
        "path", "anchors", "error", *CHOICES.values(), "random: quartiles", "order", "failed",
        title="Real paths, metres; in brackets the share of random choices that are beaten",
    )  # fmt: skip
    for row in part:
        for measure, words in (("held_out_mean_m", "held out, mean"), ("path_rmse_m", "all poses, RMSE")):
            random = row["random"].get(measure)
            if random is None:
                continue
            cells = [against(row["choices"][name], measure) if name in row["choices"] else "–" for name in CHOICES]
            quartiles = " / ".join(metres(random[key]) for key in ("lower_quartile", "median", "upper_quartile"))
            order = random["rank_correlation_with_promise"]
            failed = row["random"]["undetermined"] + row["random"]["unsettled"]
            table.add_row(
                row["path"], str(row["anchors"]), words, *cells, quartiles,
                "–" if order is None else f"{order:.2f}", str(failed),
            )  # fmt: skip
    return table


def speed_table(part: list[dict[str, Any]]) -> Table:
    """Seconds of the search on a long path."""
    table = Table(
        "poses", "knots", "anchors", "starts", "watched", "first call", "warm", "processor",
        "accuracy", "load average",
    )  # fmt: skip
    for row in part:
        table.add_row(
            *(str(row[key]) for key in ("poses", "knots", "anchors", "starts", "watched")),
            f"{row['first_call_s']:.1f} s",
            f"{row['warm_s']:.1f} s",
            f"{row['warm_processor_s']:.1f} s",
            millimetres(row["accuracy_m"]),
            f"{row['load_average']:.1f} on {row['cores']} cores",
        )
    return table


def against(choice: dict[str, Any], measure: str) -> str:
    return f"{metres(choice[measure])} ({percent(choice[f'{measure}_beats_random'], 0)})"


def metres(value: float | None) -> str:
    return "not fixed" if value is None else f"{value:.3f}"


def millimetres(value: float | None) -> str:
    return "not fixed" if value is None else f"{1000 * value:.1f} mm"


def percent(share: float, digits: int = 1) -> str:
    return f"{100 * share:.{digits}f} %"
