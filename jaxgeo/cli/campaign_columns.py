"""The columns of a campaign's table, with units in their names, and what every row has in them."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, Literal

from jaxgeo.cli.campaign_rows import SessionRow
from jaxgeo.cli.campaign_sessions import CampaignSession

Kind = Literal["text", "integer", "number", "truth"]
STAGES = ("coarse", "fixed", "learned")


@dataclasses.dataclass(frozen=True)
class CampaignColumn:
    """One column. `figure`: where its value stands in the trajectory's part of metrics.json, dotted; else None."""

    name: str
    kind: Kind
    figure: str | None = None


def _held_out(stage: str, figures: str) -> Iterator[CampaignColumn]:
    """Of one stage whose figures of `loo` stand under `figures`."""
    for name, unit in (("mean", "_m"), ("rms", "_m"), ("mean_over_locations", "_m")):
        yield CampaignColumn(f"held_out_{stage}_{name}{unit}", "number", f"{figures}.{name}_m")
    yield CampaignColumn(f"held_out_{stage}_n_failed", "integer", f"{figures}.n_failed")
    if stage != "coarse":
        yield CampaignColumn(f"held_out_{stage}_coverage_50", "number", f"{figures}.coverage_50")
        yield CampaignColumn(f"held_out_{stage}_coverage_95", "number", f"{figures}.coverage_95")


WHO = (
    CampaignColumn("session", "text"),
    CampaignColumn("folder", "text"),
    CampaignColumn("config", "text"),
    CampaignColumn("key", "text"),
    CampaignColumn("trajectory", "text"),
    CampaignColumn("odometry", "text"),
    CampaignColumn("simulated", "truth"),
    CampaignColumn("status", "text"),
    CampaignColumn("exit_code", "integer"),
    CampaignColumn("message", "text"),
    CampaignColumn("attempts", "integer"),
    CampaignColumn("seconds_s", "number"),
)
FIGURES = (
    CampaignColumn("seed", "integer", "seed"),
    CampaignColumn("n_poses", "integer", "n_poses"),
    CampaignColumn("n_visits", "integer", "n_visits"),
    CampaignColumn("n_locations", "integer", "n_locations"),
    CampaignColumn("coarse_scale", "number", "coarse.scale"),
    CampaignColumn("coarse_rms_m", "number", "coarse.rms_m"),
    CampaignColumn("repeatability_rms_m", "number", "repeatability_rms_m"),
    *(column for stage in STAGES for column in _held_out(stage, f"loo.{stage}")),
    *(CampaignColumn(f"reference_{stage}_ate_rmse_m", "number", f"reference.{stage}.ate_rmse_m") for stage in STAGES),
    CampaignColumn("solver_result", "text", "solver.result"),
    CampaignColumn("n_contrasts", "integer", "noise.learned.n_contrasts"),
)
SAID = (CampaignColumn("n_warnings", "integer"), CampaignColumn("warnings", "text"))
# Of the second pass, where the noise of the other sessions was the prior.
POOLED = (
    CampaignColumn("pooled_status", "text"),
    CampaignColumn("pooled_message", "text"),
    CampaignColumn("pooled_n_sessions", "integer"),
    *_held_out("pooled", "loo.learned"),
)
VERSIONS = ("python", "jaxgeo", "jax", "jaxlib", "optimistix", "lineax", "equinox", "numpy", "scipy", "pyproj")
VERSION_COLUMNS = tuple(CampaignColumn(f"version_{name}", "text") for name in VERSIONS)


def columns(pooled: bool) -> tuple[CampaignColumn, ...]:
    """All of the table's, from left to right."""
    return (*WHO, *FIGURES, *(POOLED if pooled else ()), *SAID, *VERSION_COLUMNS)


@dataclasses.dataclass(frozen=True)
class PooledRow:
    """Second pass over one trajectory: its row, and how many other sessions its prior was pooled from."""

    row: SessionRow | None
    n_sessions: int
    message: str = ""


def table_rows(
    sessions: Sequence[CampaignSession],
    rows: Sequence[SessionRow],
    pooled: dict[tuple[str, str], PooledRow] | None = None,
) -> list[dict[str, Any]]:
    """One row a session and trajectory, in the sessions' order; of a session without figures one row that says why.

    `pooled` is by key of the session and trajectory.
    """
    return [
        {**_who(session, row, name), **_figures(row, name), **_pooled(session, name, pooled)}
        for session, row in zip(sessions, rows, strict=True)
        for name in row.trajectories or [""]
    ]


def _who(session: CampaignSession, row: SessionRow, name: str) -> dict[str, Any]:
    return {
        "session": session.name,
        "folder": session.folder,
        "config": str(session.path),
        "key": session.key,
        "trajectory": name,
        "odometry": row.odometry.get(name, ""),
        "simulated": None if session.config is None else session.config.simulated,
        "status": row.status,
        "exit_code": row.exit_code,
        "message": row.message,
        "attempts": row.attempts,
        "seconds_s": row.seconds,
    } | {f"version_{library}": row.versions.get(library) for library in VERSIONS}


def _figures(row: SessionRow, name: str) -> dict[str, Any]:
    found = row.trajectories.get(name, {})
    warnings = found.get("warnings", [])
    return {column.name: figure(found, column.figure) for column in FIGURES} | {
        "n_warnings": len(warnings) if found else None,
        "warnings": "; ".join(warnings),
    }


def _pooled(session: CampaignSession, name: str, pooled: dict[tuple[str, str], PooledRow] | None) -> dict[str, Any]:
    if pooled is None:
        return {}
    second = pooled.get((session.key, name))
    if second is None:
        return dict.fromkeys(column.name for column in POOLED)
    row = second.row
    found = {} if row is None else row.trajectories.get(name, {})
    return {column.name: figure(found, column.figure) for column in POOLED} | {
        "pooled_status": "none" if row is None else row.status,
        "pooled_message": second.message if row is None else row.message,
        "pooled_n_sessions": second.n_sessions,
    }


def figure(found: dict[str, Any], place: str | None) -> Any:
    """The value at a dotted place; None where any part of it is missing."""
    value: Any = found
    for key in (place or "").split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return value
