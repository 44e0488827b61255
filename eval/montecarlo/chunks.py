"""The study's folder: finished chunks of sessions, each a file that is there whole or not at all."""

import dataclasses
import json
import zipfile
from pathlib import Path

import numpy as np

from eval.montecarlo.records import Records
from eval.montecarlo.settings import StudySettings, check_same
from jaxgeo.errors import InputError
from jaxgeo.export.json_text import json_text
from jaxgeo.io.atomic import atomic_path, check_output_folder

SETTINGS_FILE = "settings.json"
CHUNK_FOLDER = "chunks"


def open_folder(folder: Path, settings: StudySettings) -> None:
    """Begin a study in this folder, or go on with the one that is there.

    Raises:
        InputError: it holds another study, something else named `settings.json`, or cannot be written to.
    """
    check_output_folder(folder)
    place = folder / SETTINGS_FILE
    if place.exists():
        check_same(settings.as_dict(), _read_settings(place), str(place))
    (folder / CHUNK_FOLDER).mkdir(parents=True, exist_ok=True)
    if not place.exists():
        with atomic_path(place) as temporary:
            temporary.write_text(json_text(settings.as_dict()), encoding="utf-8")


def _read_settings(place: Path) -> dict:
    try:
        found = json.loads(place.read_text(encoding="utf-8"))
    except ValueError:
        found = None
    if not isinstance(found, dict) or "format" not in found:
        raise InputError(f"{place}: is not the settings of a Monte-Carlo study. Name another folder with --out.")
    return found


def chunk_path(folder: Path, number: int) -> Path:
    return folder / CHUNK_FOLDER / f"{number:05d}.npz"


def write_chunk(folder: Path, number: int, records: Records, settings: StudySettings) -> None:
    """Write one finished chunk."""
    arrays = {field.name: getattr(records, field.name) for field in dataclasses.fields(Records)}
    with atomic_path(chunk_path(folder, number)) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, simulated=np.array(True), digest=np.array(settings.digest), **arrays)


def read_chunks(folder: Path, settings: StudySettings) -> tuple[dict[int, Records], list[str]]:
    """Finished chunks by number, and a sentence for every file that cannot be used and will be made anew."""
    found, warnings = {}, []
    for number, sessions in enumerate(settings.chunks()):
        place = chunk_path(folder, number)
        if not place.exists():
            continue
        try:
            found[number] = _read(place, np.array(sessions), settings.digest)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            warnings.append(f"{place}: cannot be used ({error}); its sessions are computed again.")
    return found, warnings


def _read(place: Path, sessions: np.ndarray, digest: str) -> Records:
    with place.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        if str(arrays["digest"]) != digest:
            raise ValueError("of another study")
        records = Records(**{field.name: arrays[field.name] for field in dataclasses.fields(Records)})
    if not np.array_equal(records.session, sessions):
        raise ValueError(f"expected sessions {sessions[0]} to {sessions[-1]}")
    return records
