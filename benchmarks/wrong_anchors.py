"""Wrong anchors, found and named: `python -m benchmarks.wrong_anchors [--json] [--sessions N]`; docs/wrong-anchors.md.

Simulated sessions with every kind of fault, one session a seed; and real ones with labels exchanged by hand, whose data
lie in `$JAXGEO_DATA`, else in `shared/data` beside the repository. Every case is printed.
"""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import beta

from benchmarks.wrong_anchors_real import SESSIONS, real_rows
from benchmarks.wrong_anchors_simulated import Row, simulated_rows
from jaxgeo.precision import enable_compilation_cache

ROOT = Path(__file__).resolve().parents[1]
FAULTS = ("mislabelled", "exchanged", "shifted", "missed", "extra", "jumped")
# Cases without a wrong anchor.
SOUND = ("clean", "right", "jumped")


def rate(hits: Sequence[bool]) -> dict[str, Any] | None:
    """Count, share, and its exact 95 % interval (Clopper and Pearson 1934); None of no cases."""
    n, k = len(hits), int(sum(hits))
    if n == 0:
        return None
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    return {"hits": k, "of": n, "share": k / n, "interval_95": [low, high]}


def summary(simulated: Sequence[Row], real: Sequence[Row]) -> dict[str, Any]:
    """The headline figures first; shares of simulated sessions, null where none were run.

    `mislabel_found` is of one visit at a wrong place, by a wrong label or by a shift, each half the cases.
    """
    of_fault = {name: [row for row in simulated if row["fault"] == name] for name in ("clean", *FAULTS)}
    rates: dict[str, Any] = {"clean: alarm": rate([row["found"] for row in of_fault["clean"]])}
    rates["clean: alarm of the labels"] = rate([row["label_alarm"] > np.log(100.0) for row in of_fault["clean"]])
    for name in FAULTS:
        rates[f"{name}: found"] = rate([row["found"] for row in of_fault[name]])
        rates[f"{name}: found and named"] = rate([row["named"] for row in of_fault[name]])
    for name in ("shifted", "jumped"):
        rates[f"{name}: named, or beside"] = rate([row["named"] or row["truth_beside"] for row in of_fault[name]])
    for name, rows in of_fault.items():
        missed = [row for row in rows if name != "clean" and not row["named"]]
        rates[f"{name}: not named, but left open or said to be beyond testing"] = rate(
            [row["truth_open"] or row.get("truth_beside", False) or row.get("untested", 0) > 0 for row in missed]
        )
    checked = [row for row in simulated if "gate_worth" in row]
    rates["clean: gate opens"] = rate([row["gate_worth"] for row in checked if row["fault"] == "clean"])
    rates["faults: gate opens"] = rate([row["gate_worth"] for row in checked if row["fault"] != "clean"])
    blamed = [row["found"] and not (row["named"] or row["truth_beside"]) for row in of_fault["jumped"]]
    rates["jumped: an anchor blamed alone"] = rate(blamed)
    one_visit = of_fault["mislabelled"] + of_fault["shifted"]
    rates["mislabelled or shifted: found and named"] = rate([row["named"] for row in one_visit])
    for name in dict.fromkeys(row["session"] for row in real):
        own = [row for row in real if row["session"] == name]
        rates[f"{name} as it is: alarm"] = rate([row["found"] for row in own if row["fault"] == "right"])
        rates[f"{name} exchanged: found and named"] = rate([row["named"] for row in own if row["fault"] != "right"])
        rates[f"{name} exchanged: neither named nor open"] = rate(
            [not (row["named"] or row["truth_open"]) for row in own if row["fault"] != "right"]
        )

    def share(key: str) -> float | None:
        return rates[key] and rates[key]["share"]

    seconds = {name: float(np.median([r["seconds"] for r in rows])) for name, rows in of_fault.items() if rows}
    return {
        "mislabel_found": share("mislabelled or shifted: found and named"),
        "mislabel_false_alarm": share("clean: alarm"),
        "swap_found": share("exchanged: found and named"),
        "shift_found": share("shifted: found and named"),
        "rates": rates,
        "median_seconds": seconds,
        "load_average": os.getloadavg(),
    }


def line(row: Row) -> str:
    """One case in words: `ok`, the truth only `open` or beside what is named, or NOT."""
    where = row.get("session", f"seed {row.get('seed')}")
    sound = row["fault"] in SOUND and not row["found"]
    beside = row["truth_open"] or row.get("truth_beside", False)
    right = "ok" if row["named"] or sound else "open" if beside else "NOT"
    said = f"{row['said']}; beside: {', '.join(row['beside'])}" if row["beside"] else row["said"]
    return f"{right:4} {where} {row['fault']}: {row['truth']} -> {said} ({row['seconds']:.1f} s)"


def measured(
    sessions: int, seed: int, clean: int, real: Sequence[str], exchanges: int, drift: float = 1.0
) -> dict[str, Any]:
    """Every case run and said on stderr; `summary` and all rows.

    Args:
        sessions: simulated, with every fault, one a seed from `seed` on; `clean` more of the next seeds without any;
            under `drift` times the study's.
        real: names of configs; `exchanges` of each.
    """
    simulated: list[Row] = []
    for each in range(seed, seed + sessions + clean):
        for row in simulated_rows(each, drift, only_clean=each >= seed + sessions):
            simulated.append({"seed": each} | row)
            print(line(simulated[-1]), file=sys.stderr, flush=True)
    of_real: list[Row] = []
    for name in real:
        for row in real_rows(name, exchanges, seed):
            of_real.append(row)
            print(line(row), file=sys.stderr, flush=True)
    return summary(simulated, of_real) | {"simulated": simulated, "real": of_real}


def main(
    as_json: Annotated[bool, typer.Option("--json", help="All rows and rates as JSON on stdout.")] = False,
    sessions: Annotated[int, typer.Option(min=0, help="Simulated sessions, one a seed.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="The first one's.")] = 2110,
    clean: Annotated[int, typer.Option(min=0, help="More simulated sessions, of the next seeds, without a fault.")] = 0,
    real: Annotated[str, typer.Option(help="Real sessions, by their configs' names, or none.")] = ",".join(SESSIONS),
    exchanges: Annotated[int, typer.Option(min=0, help="Exchanges by hand of each real session.")] = 10,
    drift: Annotated[float, typer.Option(min=0.0, help="The simulated drift, times the study's.")] = 1.0,
) -> None:
    """Put faults into sessions and say what was found; the cases go to stderr as they are done."""
    os.environ.setdefault("JAXGEO_DATA", str(ROOT.parent / "shared" / "data"))
    enable_compilation_cache()
    found = measured(sessions, seed, clean, () if real == "none" else tuple(real.split(",")), exchanges, drift)
    if as_json:
        print(json.dumps(found, indent=2))
        return
    for key, value in found["rates"].items():
        if value is not None:
            low, high = (100.0 * x for x in value["interval_95"])
            print(
                f"{key}: {value['hits']} of {value['of']} ({100 * value['share']:.1f} %, 95 % {low:.1f} to {high:.1f})"
            )
    if found["median_seconds"]:
        print("median seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in found["median_seconds"].items()))


if __name__ == "__main__":
    typer.run(main)
