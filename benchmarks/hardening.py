"""Wrong anchors, wrong clocks, online use and campaigns, one figure each: `python -m benchmarks.hardening [--json]`.

Runs the benchmarks of each part, whose own pages say what is measured: docs/wrong-anchors.md, docs/corrections.md,
docs/online.md, docs/campaign.md. Figures of time only mean something on a machine that does nothing else. Faults put
to the commands themselves are a table of their own: `python -m benchmarks.faults`.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from jaxgeo.export.json_text import json_ready
from jaxgeo.precision import enable_compilation_cache

ROOT = Path(__file__).resolve().parents[1]
# Of each part, the figures to quote.
HEADLINE = {
    "anchors": ("mislabel_found", "mislabel_false_alarm", "swap_found"),
    "corrections": ("offset_error_ms",),
    "online": ("online_anchor_p99_ms", "online_odometry_p99_ms", "online_final_difference_m"),
    "campaign": ("campaign_rows", "campaign_speedup"),
}
SEED, EXCHANGES, ONLINE_RUNS, LOOP_SESSIONS = 3000, 10, 5, 60


def work(sessions: int, clean: int, offsets: int, campaign: int, real: bool) -> dict[str, Callable[[], dict[str, Any]]]:
    """What each part runs; of `main`'s options."""
    from benchmarks import campaign as campaigns
    from benchmarks import corrections, online, wrong_anchors
    from benchmarks.wrong_anchors_real import SESSIONS

    def in_folder() -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as place:
            return campaigns.measure(campaign, 2, LOOP_SESSIONS, Path(place))

    return {
        "online": lambda: online.measure(ONLINE_RUNS),
        "campaign": in_folder,
        "corrections": lambda: corrections.measured(offsets, held_out=False),
        "anchors": lambda: wrong_anchors.measured(sessions, SEED, clean, SESSIONS if real else (), EXCHANGES),
    }


def headline(found: dict[str, Any]) -> dict[str, Any]:
    """The figures to quote, null of a part that was not run."""
    return {
        key: None if found.get(part) is None else found[part][key] for part, keys in HEADLINE.items() for key in keys
    }


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object: the figures to quote, then every part."),
    parts: str = typer.Option(",".join(HEADLINE), help="Some of these, separated by commas."),
    sessions: int = typer.Option(60, min=1, help="Simulated sessions with wrong anchors, every fault of each."),
    clean: int = typer.Option(340, min=0, help="More of them without a fault."),
    offsets: int = typer.Option(30, min=1, help="Simulated sessions of each kind with a wrong clock."),
    campaign: int = typer.Option(500, min=2, help="Sessions of the campaign."),
    real: bool = typer.Option(True, help="Real sessions with labels exchanged by hand, too."),
) -> None:
    asked = [part for part in parts.split(",") if part]
    unknown = [part for part in asked if part not in HEADLINE]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]!r}; expected some of {', '.join(HEADLINE)}.", param_hint="--parts")
    os.environ.setdefault("JAXGEO_DATA", str(ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    found: dict[str, Any] = {}
    seconds: dict[str, float] = {}
    for part, run in work(sessions, clean, offsets, campaign, real).items():
        if part in asked:
            started = time.perf_counter()
            found[part] = run()
            seconds[part] = time.perf_counter() - started
    quoted = headline(found)
    if as_json:
        whole = quoted | found | {"seconds": seconds, "load_average": os.getloadavg()}
        print(json.dumps(json_ready(whole), allow_nan=False))
        return
    for key, value in quoted.items():
        print(f"{key:<28}{'not run' if value is None else f'{value:.4g}'}")
    print("seconds: " + ", ".join(f"{part} {value:.0f}" for part, value in seconds.items()))


if __name__ == "__main__":
    typer.run(main)
