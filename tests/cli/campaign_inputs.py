"""Small sessions of a campaign, and a cluster that is this process."""

import contextlib
import json
from pathlib import Path

import small_session

from jaxgeo.cli.campaign_pass import CampaignAsked
from jaxgeo.cli.campaign_rows import SessionRow
from jaxgeo.cli.campaign_sessions import CampaignSession, campaign_sessions
from jaxgeo.cli.campaign_task import Task, library_versions, run_task

VERSIONS = library_versions()


def write_session(folder: Path, name: str = "small") -> Path:
    """One small session; its config, whose noise is fixed and nothing held out."""
    folder.mkdir(parents=True)
    small_session.write_small_session(folder)
    for other in ("corners", "stops", "truth"):
        (folder / f"{other}.yaml").unlink()
    (folder / "rig.yaml").unlink()
    config = folder / "poses.yaml"
    config.write_text(config.read_text().replace("name: small", f"name: {name}"))
    return config


def run_here(monkeypatch) -> list[Task]:
    """Let campaigns run their tasks in this process, one after the other; what was run is kept in the list."""
    ran: list[Task] = []

    def run_tasks(_client, tasks, done):
        for task in tasks:
            ran.append(task)
            done(task, run_task(task))

    monkeypatch.setattr("jaxgeo.cli.campaign_pass.run_tasks", run_tasks)
    monkeypatch.setattr("jaxgeo.cli.campaign.campaign_client", lambda *_: contextlib.nullcontext())
    return ran


def asked(out: Path, *sessions: Path, **options) -> CampaignAsked:
    return CampaignAsked([str(path) for path in sessions], out, 1, quiet=True, **options)


def sessions_of(*paths: Path, out: Path) -> list[CampaignSession]:
    return campaign_sessions([path.resolve() for path in paths], [], VERSIONS, out)


def row(key: str, **values) -> SessionRow:
    given = {"run": "a", "status": "ok", "exit_code": 0, "message": "", "attempts": 1, "seconds": 1.0}
    return SessionRow(key=key, **(given | values))


def summary_of(out: Path) -> dict:
    return json.loads((out / "summary.json").read_text())
