"""The second pass of a campaign: every session learned again, from the noise pooled over the other sessions."""

import dataclasses
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxgeo.cli.campaign_columns import PooledRow
from jaxgeo.cli.campaign_noise_file import any_simulated, keep_or_write, pooled_noise_text, pooled_values
from jaxgeo.cli.campaign_pass import CampaignAsked, rows_of, run_pass
from jaxgeo.cli.campaign_pool import HeldOutGroup, Platform, pooled_platforms
from jaxgeo.cli.campaign_rows import SessionRow
from jaxgeo.cli.campaign_sessions import CampaignSession, config_key
from jaxgeo.cli.campaign_task import Task
from jaxgeo.cli.progress import Progress
from jaxgeo.config.schema import SessionConfig

if TYPE_CHECKING:
    from jaxgeo.cli.campaign_cluster import Client

Place = tuple[str, str]
POOLED_NOISE, PRIORS = "pooled_noise.json", "priors"
_ALONE = "no other recording of its platform in the campaign"


def second_pass(
    asked: CampaignAsked,
    sessions: Sequence[CampaignSession],
    rows: Sequence[SessionRow],
    first: Sequence[Task],
    out: Path,
    client: "Callable[[], Client]",
    progress: Progress,
) -> tuple[dict[Place, PooledRow], dict[str, Any]]:
    """Pool, write `pooled_noise.json`, and run every session again; by key and trajectory. And each platform's noise.

    Raises:
        ConfigError: nothing to pool.
        InputError: files cannot be written, or the cluster failed.
    """
    platforms, said = pooled_platforms(sessions, rows, asked.pool_by)
    for sentence in said:
        print(f"warning: {sentence}", file=sys.stderr)
    values = {each.label: pooled_values(each, each.whole, each.members) for each in platforms}
    simulated = any_simulated([member for each in platforms for member in each.members])
    keep_or_write(out / POOLED_NOISE, pooled_noise_text("pooled", simulated, values))
    found, tasks = _second_tasks(platforms, {task.key: task for task in first}, out)
    run_pass(list(tasks.values()), client, progress, "sessions with pooled noise", asked.fresh)
    for place, row in zip(tasks, rows_of(list(tasks.values())), strict=True):
        found[place] = dataclasses.replace(found[place], row=row)
    return found, {label: each["pooled"] for label, each in values.items()}


def _second_tasks(
    platforms: Sequence[Platform], first: dict[str, Task], out: Path
) -> tuple[dict[Place, PooledRow], dict[Place, Task]]:
    """By key and trajectory: what is known before the pass, and the task of each that has a prior."""
    found: dict[Place, PooledRow] = {}
    tasks: dict[Place, Task] = {}
    for platform in platforms:
        for number, group in enumerate(platform.groups):
            prior = None if group.population is None else _write_prior(platform, group, number, out)
            for member in group.members:
                place = (member.session.key, member.trajectory)
                if group.population is None or prior is None:
                    found[place] = PooledRow(None, 0, _ALONE)
                    continue
                task = first[member.session.key]
                assert task.config is not None  # it has a row with learned noise
                config = learned_from(task.config, member.trajectory, prior)
                key = config_key(member.session.path, config, task.versions, out)
                tasks[place] = dataclasses.replace(task, config=config, key=key, outputs=False, evaluate=False)
                found[place] = PooledRow(None, group.population.n_sessions)
    return found, tasks


def _write_prior(platform: Platform, group: HeldOutGroup, number: int, out: Path) -> Path:
    """The noise pooled from the others of a group; the file stays as it is where it says the same."""
    assert group.population is not None
    path = out / PRIORS / platform.label / f"{number:03d}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    values = pooled_values(platform, group.population, group.others)
    keep_or_write(path, pooled_noise_text("pooled", any_simulated(group.others), {platform.label: values}))
    return path


def learned_from(config: SessionConfig, trajectory: str, prior: Path) -> SessionConfig:
    """The session with one of its trajectories, learned from the prior in a file.

    A mapped trajectory keeps the one that it follows.
    """
    names = {trajectory}
    if getattr(config.trajectories[trajectory], "computed", None) == "mapping":
        names.add(config.mapped_along(trajectory))
    noise = config.noise.model_copy(update={"file": prior, "trajectory": None, "use": "prior"})
    kept = {name: source for name, source in config.trajectories.items() if name in names}
    return config.model_copy(update={"noise": noise, "trajectories": kept})
