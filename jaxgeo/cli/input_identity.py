"""What a kept result was made from, in one hash: settings, input files and the code that made it."""

import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jaxgeo


def facts_key(facts: dict[str, Any]) -> str:
    """Hash of plain facts, whatever their order."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def file_identities(paths: Iterable[Path], ours: Path) -> list[tuple[str, int, int]]:
    """Name, size and time of change of every file, those in folders included; not of what lies in our own folder."""
    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = (file for file in sorted(path.rglob("*")) if file.is_file())
            found += [file for file in inside if ours.resolve() not in file.resolve().parents]
        else:
            found.append(path)
    return [(path.name, (stat := path.stat()).st_size, stat.st_mtime_ns) for path in found]


@functools.cache
def code_hash(*packages: str) -> str:
    """Of the source of parts of jaxgeo (`detect`, ..): another version may find something else."""
    code = hashlib.sha256()
    for package in packages:
        for path in sorted((Path(jaxgeo.__file__).parent / package).glob("*.py")):
            code.update(path.read_bytes())
    return code.hexdigest()
