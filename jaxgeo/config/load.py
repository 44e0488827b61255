"""A config file to a checked config of its kind, and back to text."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from jaxgeo.config.fields import Section
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import ConfigError
from jaxgeo.io.regular_file import read_whole
from jaxgeo.io.yaml_text import MAX_BYTES, dump_yaml, parse_yaml

_SIGHTING_KINDS = ("corners", "poses", "images", "control_points", "from_trajectory")
CONFIG_BYTES = 4 * MAX_BYTES  # a character of UTF-8 has up to four
Config = TypeVar("Config", bound=Section)


def load_config(path: Path | str, overrides: Sequence[str] = ()) -> SessionConfig:
    """Read, override and check a session's config, as `read_config` does."""
    return read_config(path, SessionConfig, overrides)


def read_config(path: Path | str, kind: type[Config], overrides: Sequence[str] = ()) -> Config:
    """Read, override and check a config.

    Args:
        path: a YAML file. Relative paths in it are relative to its folder; `${JAXGEO_DATA}` is expanded.
        kind: its schema, whose main keys have a description.
        overrides: `key.sub=value`, the value in YAML, as given to `--set`.

    Raises:
        ConfigError: naming file, dotted key, value and expectation.
    """
    path = Path(path)
    try:
        text = read_whole(path, ConfigError, CONFIG_BYTES).decode("utf-8-sig")
        data = parse_yaml(text)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the config: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8 text; expected a YAML file") from None
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
    if not isinstance(data, dict):
        found = "nothing" if data is None else type(data).__name__
        main = ", ".join(name for name, field in kind.model_fields.items() if field.description)
        raise ConfigError(f"{path}: holds {found}; expected a mapping with the keys {main}")
    for override in overrides:
        _set(data, override)
    try:
        return kind.model_validate(data, context={"folder": path.parent.absolute()})
    except ValidationError as error:
        raise ConfigError(f"{path}: {described(error)}") from None


def dump_config(config: Section) -> str:
    """The whole config as YAML, defaults written out and paths resolved; it loads back to the same config."""
    return dump_yaml(config.model_dump(mode="json"))


def _set(data: dict[str, Any], override: str) -> None:
    """Set one `key.sub=value` in place."""
    # Bytes of the command line that are no text would not print
    place = f"--set {override.encode('utf-8', 'backslashreplace').decode()[:200]}"
    dotted, equals, text = override.partition("=")
    keys = dotted.split(".")
    if any("\ud800" <= character <= "\udfff" for character in override):
        raise ConfigError(f"{place}: holds bytes that are no text; expected UTF-8")
    if not equals or not all(keys):
        raise ConfigError(f"{place}: expected key=value or key.sub=value")
    try:
        value = parse_yaml(text)
    except ValueError as error:
        raise ConfigError(f"{place}: the value is not YAML: {error}") from None
    for depth, key in enumerate(keys[:-1]):
        data = data.setdefault(key, {})
        if not isinstance(data, dict):
            parent = ".".join(keys[: depth + 1])
            raise ConfigError(f"{place}: {parent} is {data!r}, which has no keys; set {parent} as a whole")
    data[keys[-1]] = value


def described(error: ValidationError) -> str:
    """The first thing wrong, and how many more there are."""
    first, *more = error.errors(include_url=False)
    message = _describe(first)
    return message + (f" (and {len(more)} more)" if more else "")


def _describe(detail: ErrorDetails) -> str:
    place = ".".join(str(part) for part in _location(detail["loc"]))
    value, kind = detail["input"], detail["type"]
    if kind == "union_tag_not_found":
        return f"{place}: missing key 'kind': expected one of {', '.join(_SIGHTING_KINDS)}"
    if kind == "union_tag_invalid":
        return f"{place}.kind: found {value['kind']!r}; expected one of {', '.join(_SIGHTING_KINDS)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{place}: found {_shown(value)}; expected a mapping (key: value)"
    text = detail["msg"].removeprefix("Value error, ").replace("Input should", "it should")
    text = {"bool_type": "expected true or false", "too_short": "expected at least one entry"}.get(kind, text)
    # A section's own message names the keys concerned: its whole content would only hide it.
    shown = "" if isinstance(value, dict) else f"found {_shown(value)}; "
    return f"{place}: {shown}{text}" if place else f"{shown}{text}"


def _location(loc: tuple[int | str, ...]) -> list[int | str]:
    """Without what pydantic adds: tags of the sightings' and trajectories' kinds, and the mark of a mapping's key."""
    tag = None
    if len(loc) > 1 and loc[0] == "sightings" and loc[1] in _SIGHTING_KINDS:
        tag = 1
    elif len(loc) > 2 and loc[0] == "trajectories" and loc[2] in ("file", "computed"):
        tag = 2
    return [part for i, part in enumerate(loc) if part != "[key]" and i != tag]


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
