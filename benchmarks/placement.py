"""Where to put anchors, and what a plan's promises are worth: `python -m benchmarks.placement [--json]`.

Four parts, each on its own with --parts: promised against achieved accuracy over simulated sessions; the gradient
search beside every choice of a fine grid, on three shapes of path; planned anchors on real paths; and how long a
search takes. The real data lie in `$JAXGEO_DATA`, else in `shared/data` beside the repository.
"""

import json
import os
import time
from pathlib import Path
from typing import Any

import typer

from jaxgeo.precision import enable_compilation_cache

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("simulated", "shapes", "real", "speed")


def measured(
    parts: tuple[str, ...],
    data: Path,
    *,
    sessions: int,
    random: int,
    counts: tuple[int, ...],
    further: bool,
    starts: int,
    seed: int,
) -> dict[str, Any]:
    """The parts asked for; the headline figures first, null where their part was not asked for."""
    from benchmarks.placement_real import real_rows
    from benchmarks.placement_shapes import shapes
    from benchmarks.placement_simulated import simulated
    from benchmarks.placement_speed import speed

    work = {
        "simulated": lambda: simulated(sessions, seed),
        "shapes": lambda: shapes(starts, seed),
        "real": lambda: real_rows(data, counts, random, seed, further=further),
        "speed": lambda: speed(starts, seed),
    }
    found: dict[str, Any] = dict.fromkeys(work)
    seconds = {}
    for part in parts:
        started = time.perf_counter()
        found[part] = work[part]()
        seconds[part] = time.perf_counter() - started
    return headline(found) | found | {"seconds": seconds, "load_average": os.getloadavg(), "seed": seed}


def headline(found: dict[str, Any]) -> dict[str, Any]:
    """One number a part: simulated sessions under the noise they were drawn from; 64 points of the path watched."""
    simulated, shapes, speed = (found[part] for part in ("simulated", "shapes", "speed"))
    return {
        "predicted_over_achieved": simulated and simulated["all"]["true_noise"]["predicted_over_achieved"],
        "gap_to_exhaustive": shapes and shapes["gap_to_exhaustive"],
        "seconds_64_starts": speed and speed[0]["warm_s"],
    }


def main(
    as_json: bool = typer.Option(False, "--json", help="One JSON object."),
    parts: str = typer.Option(",".join(PARTS), help="Some of these, separated by commas."),
    sessions: int = typer.Option(600, min=3, help="Simulated sessions, all regimes together."),
    random: int = typer.Option(200, min=1, help="Random choices of anchors on every real path."),
    counts: str = typer.Option("6", help="Numbers of anchors on real paths, separated by commas."),
    further: bool = typer.Option(False, "--further", help="KITTI 05, 06 and 07 too."),
    starts: int = typer.Option(64, min=2, help="Of the gradient search."),
    seed: int = typer.Option(0, help="Of everything that is drawn."),
) -> None:
    asked = tuple(part for part in parts.split(",") if part)
    unknown = [part for part in asked if part not in PARTS]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]!r}; expected some of {', '.join(PARTS)}.", param_hint="--parts")
    os.environ.setdefault("JAXGEO_DATA", str(ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    found = measured(
        asked,
        Path(os.environ["JAXGEO_DATA"]),
        sessions=sessions,
        random=random,
        counts=tuple(int(count) for count in counts.split(",")),
        further=further,
        starts=starts,
        seed=seed,
    )
    if as_json:
        print(json.dumps(found, allow_nan=False))
    else:
        from benchmarks.placement_tables import print_tables

        print_tables(found)


if __name__ == "__main__":
    typer.run(main)
