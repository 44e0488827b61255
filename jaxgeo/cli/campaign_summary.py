"""summary.json: what a campaign's table says at a glance, and what pooling its sessions' noise gained."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

Row = Mapping[str, Any]
# At most so many locations: a fold has one less to learn from.
SHORT_LOCATIONS = 5
LISTED_FAILURES = 20
_BOOTSTRAPS = 2000


def summary(rows: Sequence[Row], versions: Mapping[str, str], seconds: float, computed: int) -> dict[str, Any]:
    """Counts, failures and mean ratios of held-out errors.

    Args:
        rows: of the table.
        seconds: of this command; `computed` sessions in it, the others were there already.
    """
    sessions = {row["key"]: row for row in rows}
    failed = [row for row in sessions.values() if row["status"] != "ok"]
    good = [row for row in rows if row["status"] == "ok"]
    return {
        "n_sessions": len(sessions),
        "n_rows": len(rows),
        "simulated": any(row["simulated"] for row in rows),
        "status": dict(Counter(row["status"] for row in sessions.values())),
        "n_restarted": sum(row["attempts"] > 1 for row in sessions.values()),
        "exit_code": exit_code(failed),
        "failures": [
            {key: row[key] for key in ("session", "config", "status", "exit_code", "message")} for row in failed
        ],
        "held_out": {
            kind: _held_out([row for row in good if kind in ("all", row["odometry"])])
            for kind in ("all", *dict.fromkeys(row["odometry"] for row in good))
        },
        "computed_sessions": computed,
        "elapsed_s": seconds,
        "versions": dict(versions),
    }


def exit_code(failed: Iterable[Row]) -> int:
    """0 where nothing failed; else the gravest: 1 a fault of jaxgeo, 2 bad input, 3 no estimate."""
    return min((row["exit_code"] for row in failed), default=0)


def _held_out(rows: Sequence[Row]) -> dict[str, Any]:
    return {
        "fixed_over_coarse": gain(rows, "fixed", "coarse"),
        "learned_over_coarse": gain(rows, "learned", "coarse"),
        "learned_over_fixed": gain(rows, "learned", "fixed"),
    }


def pool_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """What the second pass gained: pooled over learned alone, of all rows that have both, and of short sessions."""
    both = [row for row in rows if row.get("pooled_status") == "ok"]
    short = [row for row in both if row["n_locations"] <= SHORT_LOCATIONS]
    failed = [row for row in rows if row.get("pooled_status") not in (None, "ok")]
    return {
        "all": _pooled(both),
        f"at_most_{SHORT_LOCATIONS}_locations": _pooled(short),
        "n_without": len(failed),
        "without": [
            {key: row[key] for key in ("session", "trajectory", "pooled_status", "pooled_message")}
            for row in failed[:LISTED_FAILURES]
        ],
    }


def _pooled(rows: Sequence[Row]) -> dict[str, Any]:
    def mean(column: str) -> float | None:
        values = [row[column] for row in rows if row[column] is not None]
        return math.fsum(values) / len(values) if values else None

    return {
        "pooled_over_learned": gain(rows, "pooled", "learned"),
        "pooled_over_fixed": gain(rows, "pooled", "fixed"),
        "learned_over_fixed": gain(rows, "learned", "fixed"),
        **{
            f"coverage_{level}_{stage}": mean(f"held_out_{stage}_coverage_{level}")
            for level in (50, 95)
            for stage in ("fixed", "learned", "pooled")
        },
    }


def gain(rows: Sequence[Row], stage: str, over: str) -> dict[str, Any]:
    """Held-out mean errors of a stage over another's: geometric mean over rows, its 95 % interval, share below 1.

    The interval is a bootstrap over rows; null below two.
    """
    pairs = [(row[f"held_out_{stage}_mean_m"], row[f"held_out_{over}_mean_m"]) for row in rows]
    logs = np.array([math.log(a / b) for a, b in pairs if a is not None and b is not None and a > 0 and b > 0])
    if not len(logs):
        return {"n": 0, "ratio": None, "interval_95": None, "share_better": None}
    drawn = np.random.default_rng(0).integers(0, len(logs), (_BOOTSTRAPS, len(logs)))
    ends = np.exp(np.quantile(logs[drawn].mean(axis=1), (0.025, 0.975))).tolist()
    return {
        "n": len(logs),
        "ratio": float(np.exp(logs.mean())),
        "interval_95": ends if len(logs) > 1 else None,
        "share_better": float((logs < 0).mean()),
    }
