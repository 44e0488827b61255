"""Which sessions a campaign has: configs from files, folders, globs and lists, each once, each with its key."""

import dataclasses
import glob
import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxgeo.cli.input_identity import facts_key, file_identities
from jaxgeo.config import load_config
from jaxgeo.config.load import CONFIG_BYTES
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import ConfigError, InputError
from jaxgeo.io.regular_file import head_of, read_whole
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.yaml_text import parse_yaml

CONFIG_SUFFIXES = (".yaml", ".yml")
_GLOB_MARKS = frozenset("*?[")
_SHORT = 8


@dataclasses.dataclass(frozen=True)
class CampaignSession:
    """One session of a campaign.

    Attributes:
        path: of its config, absolute.
        config: None where it was refused, for the reason in `refused`.
        name: the config's, else the file's stem; `folder` the same, told apart from others of that name.
        key: hash of path, resolved config, input files and versions: a row with this key is this session's, done.
    """

    path: Path
    config: SessionConfig | None
    refused: str
    name: str
    folder: str
    key: str


def config_paths(given: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Every config that the arguments name, once, in their order; and what is to be said of those left out.

    Raises:
        InputError: an argument that names nothing, or no config at all.
    """
    found: list[Path] = []
    said: list[str] = []
    for text in given:
        found += _of_argument(text, Path(), said, in_list=False)
    absolute = [Path(path).resolve() for path in found]
    once = list(dict.fromkeys(absolute))
    if len(once) < len(absolute):
        said.append(f"{len(absolute) - len(once)} config(s) were named more than once: each is run once")
    return once, said


def _of_argument(text: str, folder: Path, said: list[str], *, in_list: bool) -> list[Path]:
    path = folder / text
    try:
        is_folder = path.is_dir()
    except OSError as failure:  # a name too long
        raise InputError(f"{text[:80]}: {failure.strerror}; expected a config, a folder or a glob of configs") from None
    if is_folder:
        return _of_folder(path, said)
    if path.is_file():
        if path.suffix.lower() in CONFIG_SUFFIXES:
            return [path]
        if in_list:
            raise InputError(f"{path}: a list of sessions names another list; expected configs, folders or globs in it")
        return _of_list(path, said)
    if _GLOB_MARKS & set(text):
        try:
            matches = sorted(glob.glob(str(path), recursive=True))
        except OSError as failure:  # of a folder that goes while it is listed
            raise InputError(
                f"{text[:80]}: {failure.filename}: {failure.strerror}; expected a glob of configs"
            ) from None
        if not matches:
            raise InputError(f"{text}: no file matches; expected configs of sessions (YAML). Check folder and pattern.")
        return [found for match in matches for found in _of_argument(match, Path(), said, in_list=in_list)]
    raise InputError(
        f"{path}: no such file or folder; expected a session's config (YAML), a folder or a glob of configs, or a text "
        "file that lists them"
    )


def _of_folder(folder: Path, said: list[str]) -> list[Path]:
    """YAML files in the folder and below that have the key `sightings`, and those that cannot be read as YAML."""
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in CONFIG_SUFFIXES and path.is_file())
    files = [path for path in files if not any(part.startswith(".") for part in path.relative_to(folder).parts)]
    found = [path for path in files if _may_be_a_session(path)]
    if not found:
        raise InputError(
            f"{folder}: holds no config of a session ({len(files)} YAML files, none with the key 'sightings')"
        )
    if len(found) < len(files):
        other = [str(path.relative_to(folder)) for path in files if path not in set(found)]
        shown = ", ".join(other[:3]) + (", .." if len(other) > 3 else "")
        said.append(f"{folder}: {len(other)} YAML file(s) without the key 'sightings' left out: {shown}")
    return found


def _may_be_a_session(path: Path) -> bool:
    try:
        content = parse_yaml(read_whole(path, InputError, CONFIG_BYTES).decode("utf-8-sig"))
    except (InputError, OSError, ValueError):  # a broken config is to fail its own row, with its message
        return True
    return isinstance(content, dict) and "sightings" in content


def _of_list(path: Path, said: list[str]) -> list[Path]:
    found: list[Path] = []
    for number, line in enumerate(read_lines(path), start=1):
        text = line.split("#", 1)[0].strip()
        if not text:
            continue
        try:
            found += _of_argument(text, path.parent, said, in_list=True)
        except InputError as error:
            raise InputError(f"{path}:{number}: {error}") from None
    if not found:
        raise InputError(f"{path}: lists no session; expected one config, folder or glob a line")
    return found


def campaign_sessions(
    paths: Sequence[Path], overrides: Sequence[str], versions: Mapping[str, str], out: Path
) -> list[CampaignSession]:
    """Load every config; one that is refused stays, with its message.

    Raises:
        ConfigError: an override (`--set`) that is malformed: no session can have it.
    """
    for override in overrides:
        if not all([*override.partition("=")[0].split("."), override.partition("=")[1]]):
            raise ConfigError(f"--set {override}: expected key=value or key.sub=value")
    sessions = [_session(path, overrides, versions, out) for path in paths]
    count = Counter(session.name for session in sessions)
    return [
        dataclasses.replace(each, folder=f"{each.name}-{_hash(str(each.path))[:_SHORT]}")
        if count[each.name] > 1
        else each
        for each in sessions
    ]


def _session(path: Path, overrides: Sequence[str], versions: Mapping[str, str], out: Path) -> CampaignSession:
    try:
        config = load_config(path, overrides)
    except InputError as error:
        content = head_of(path) if path.is_file() else b""
        facts = {"refused": hashlib.sha256(content).hexdigest(), "overrides": list(overrides), "error": str(error)}
        return CampaignSession(path, None, str(error), path.stem, path.stem, session_key(path, facts, versions))
    return CampaignSession(path, config, "", config.name, config.name, config_key(path, config, versions, out))


def config_key(path: Path, config: SessionConfig, versions: Mapping[str, str], out: Path) -> str:
    """Of a session whose config was accepted; nothing that lies in `out`, the campaign's own folder, counts."""
    files: list[Any] = []
    for file in sorted(set(paths_in(config.model_dump()))):
        try:
            files.append(file_identities([file], out))
        except OSError:  # reading it will say so, in the session's own row
            files.append([str(file), "missing"])
    return session_key(path, {"config": config.model_dump(mode="json"), "files": files}, versions)


def session_key(path: Path, facts: Mapping[str, Any], versions: Mapping[str, str]) -> str:
    """Hash of a session's path, of facts about it and of the versions that work on it."""
    return facts_key({"path": str(path), "facts": dict(facts), "versions": dict(versions)})


def paths_in(value: Any) -> Iterator[Path]:
    """Every path anywhere in a config's values."""
    if isinstance(value, Path):
        yield value
    elif isinstance(value, Mapping):
        yield from _paths_of(value.values())
    elif isinstance(value, list | tuple):
        yield from _paths_of(value)


def _paths_of(values: Iterable[Any]) -> Iterator[Path]:
    for value in values:
        yield from paths_in(value)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
