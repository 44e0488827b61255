"""YAML files that hold a mapping."""

from pathlib import Path
from typing import Any

from jaxgeo.errors import ConfigError, InputError
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.yaml_text import parse_yaml


def read_yaml(path: str | Path, error: type[InputError] = ConfigError) -> dict[str, Any]:
    """The mapping in a YAML file, read as `parse_yaml` does.

    Raises:
        error: the file cannot be read, is not YAML, repeats a key, or holds no mapping; with file and line.
    """
    text = "\n".join(read_lines(path, error))
    try:
        content = parse_yaml(text)
    except ValueError as failure:
        raise error(f"{path}: {failure}. Check the indentation, colons and brackets there.") from None
    if not isinstance(content, dict):
        found = "nothing but comments" if content is None else f"a {type(content).__name__}"
        raise error(f"{path}: holds {found}, expected a mapping `key: value`.")
    return content
