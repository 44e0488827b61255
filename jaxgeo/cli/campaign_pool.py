"""Which sessions of a campaign are of one platform, and the noise pooled from them, with and without each."""

import dataclasses
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.models import FamilyPrior, family_prior
from calibration.pooling import Population, SessionEvidence, population, population_without, session_evidence
from calibration.result import ModelEstimate
from jaxgeo.cli.campaign_columns import figure
from jaxgeo.cli.campaign_rows import SessionRow
from jaxgeo.cli.campaign_sessions import CampaignSession, paths_in
from jaxgeo.errors import ConfigError
from jaxgeo.graph.components import COMPONENTS
from jaxgeo.graph.noise_defaults import default_noise

# Of more recordings than this, several are held out together: the others say the same with or without one more.
MOST_GROUPS = 40
_SHORT = 8


@dataclasses.dataclass(frozen=True)
class Member:
    """One trajectory of one session, as it stands in a platform: what was learned of it, and from which files."""

    session: CampaignSession
    row: SessionRow
    trajectory: str
    evidence: SessionEvidence
    model_weight: dict[str, float]
    files: frozenset[Path]


@dataclasses.dataclass(frozen=True)
class HeldOutGroup:
    """Members of a platform that get one prior, pooled from the `others`; `population` None where there are none."""

    members: tuple[Member, ...]
    others: tuple[Member, ...]
    population: Population | None


@dataclasses.dataclass(frozen=True)
class Platform:
    """Sessions whose odometry is of one make.

    Attributes:
        label: kind of odometry, trajectory's name, and value of the key that tells platforms apart, where one is given.
        kind: of odometry; `family` its documented prior.
        members: learned trajectories; `whole` their common noise.
        groups: the same members held out in turn: one recording a group, or several where there are many.
    """

    label: str
    kind: str
    family: FamilyPrior
    members: tuple[Member, ...]
    whole: Population
    groups: tuple[HeldOutGroup, ...]


def pooled_platforms(
    sessions: Sequence[CampaignSession], rows: Sequence[SessionRow], pool_by: str | None
) -> tuple[list[Platform], list[str]]:
    """Platforms in the order of their first session, and what is to be said of sessions that are in none.

    Args:
        pool_by: dotted key of the configs; sessions with different values there (of a file: with different content) are
            of different platforms.

    Raises:
        ConfigError: nothing to pool, or a config that does not have the key.
    """
    members: dict[str, list[Member]] = {}
    kinds: dict[str, str] = {}
    left_out = 0
    for session, row in zip(sessions, rows, strict=True):
        if session.config is None or row.status != "ok":
            continue
        # Learned from another session already, or not at all: its posterior is not its own data's.
        if session.config.noise.mode == "fixed" or session.config.noise.file is not None:
            left_out += 1
            continue
        for name, learned in row.learned.items():
            label = _label(session, learned["kind"], name, pool_by)
            kinds[label] = learned["kind"]
            members.setdefault(label, []).append(_member(session, row, name, learned))
    if not members:
        raise ConfigError(
            "--pool: no session has noise that was learned from itself alone (noise.mode: learned, no noise.file), so "
            "there is nothing to pool"
        )
    said = []
    if left_out:
        said.append(f"{left_out} session(s) with noise.mode: fixed or a noise.file are not pooled")
    return [_platform(label, kinds[label], found) for label, found in members.items()], said


def _label(session: CampaignSession, kind: str, trajectory: str, pool_by: str | None) -> str:
    parts = [kind] if trajectory == kind else [kind, trajectory]
    if pool_by is not None:
        assert session.config is not None
        value = figure(session.config.model_dump(mode="json"), pool_by)
        if value is None:
            raise ConfigError(
                f"{session.path}: --pool-by {pool_by}: the config has no value there; expected a dotted key that tells "
                "platforms apart, such as rig.file"
            )
        parts.append(_value_label(value))
    return "_".join(parts)


def _value_label(value: Any) -> str:
    """A value as part of a file's name, one for each value; a file is what it holds: copies of a rig are one rig."""
    if isinstance(value, str) and Path(value).is_file():
        return f"{Path(value).stem}-{hashlib.sha256(Path(value).read_bytes()).hexdigest()[:_SHORT]}"
    text = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
    plain = re.sub(r"[^A-Za-z0-9.-]+", "-", text)[:40].strip(".")
    return plain if plain == text else f"{plain}-{hashlib.sha256(text.encode()).hexdigest()[:_SHORT]}"


def _member(session: CampaignSession, row: SessionRow, name: str, learned: Mapping[str, Any]) -> Member:
    kind = learned["kind"]
    family = family_prior(kind, default_noise(kind))
    models = [model_of(values) for values in learned["models"]]
    mean = family.mean.copy()
    for sigma in learned["sigmas"]:
        if sigma["component"] in COMPONENTS:
            mean[COMPONENTS.index(sigma["component"])] = np.log(sigma["prior_median"])
    assert session.config is not None
    files = paths_in(session.config.trajectories[name].model_dump())
    return Member(
        session,
        row,
        name,
        session_evidence(models, mean, family.covariance),
        {model.name: model.weight for model in models},
        frozenset(path.resolve() for path in files),
    )


def model_of(values: Mapping[str, Any]) -> ModelEstimate:
    """One model as noise.json has it; of one that was not found the numbers may be missing."""
    numbers = {key: np.array(values[key], dtype=float) for key in ("sigma", "log_sd", "correlation")}
    components = tuple(values["components"])
    return ModelEstimate(**{**values, **numbers, "components": components})


def _platform(label: str, kind: str, members: Sequence[Member]) -> Platform:
    family = family_prior(kind, default_noise(kind))
    evidence = [member.evidence for member in members]
    held_out: dict[int, list[int]] = {}
    for i, recording in enumerate(recordings(members)):
        held_out.setdefault(recording % MOST_GROUPS, []).append(i)
    groups = tuple(
        HeldOutGroup(
            tuple(members[i] for i in group),
            tuple(member for i, member in enumerate(members) if i not in set(group)),
            population_without(evidence, group, family.covariance),
        )
        for group in held_out.values()
    )
    return Platform(label, kind, family, tuple(members), population(evidence, family.covariance), groups)


def recordings(members: Sequence[Member]) -> list[int]:
    """The number of each member's recording: of members that share a session or a trajectory's file, one number.

    One says nothing new of the noise to the other.
    """
    marks = [{member.session.key, *member.files} for member in members]
    number = list(range(len(members)))
    first: dict[str | Path, int] = {}
    for i, own in enumerate(marks):
        joined = {number[first[mark]] for mark in own if mark in first} | {i}
        number = [min(joined) if n in joined else n for n in number]
        first |= {mark: i for mark in own if mark not in first}
    order = {n: i for i, n in enumerate(dict.fromkeys(number))}
    return [order[n] for n in number]
