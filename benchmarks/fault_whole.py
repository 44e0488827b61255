"""What a folder holds, and whether each of its files is whole."""

import hashlib
import json
import os
import stat
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from jaxgeo.errors import JaxgeoError
from jaxgeo.io.ply import ply_vertices, read_ply_header
from jaxgeo.io.tum import read_tum
from jaxgeo.io.yaml_file import read_yaml

HASHED_BYTES = 1 << 24  # the sparse files of ten gigabytes are told by their size alone
TEMPORARY = ".tmp"


def snapshot(folder: Path, without: tuple[Path, ...] = ()) -> dict[str, str]:
    """Every entry below a folder but those in `without`: its kind, its size, its hash, or where a link leads."""
    found: dict[str, str] = {}
    for parent, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if Path(parent, name) not in without]
        for name in (*folders, *files):
            path = Path(parent, name)
            if path not in without:
                found[path.relative_to(folder).as_posix()] = _described(path)
    return found


def _described(path: Path) -> str:
    status = path.lstat()
    if stat.S_ISLNK(status.st_mode):
        return f"link to {path.readlink()}"
    if not stat.S_ISREG(status.st_mode):
        return f"no file, {stat.S_IFMT(status.st_mode):o}"
    if status.st_size > HASHED_BYTES:
        return f"{status.st_size} bytes"
    return f"{status.st_size} bytes, {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"


def changes(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """What came, went or changed from one snapshot to the next."""
    return [
        f"{name}: {before.get(name, 'absent')} -> {after.get(name, 'absent')}"
        for name in sorted({*before, *after})
        if before.get(name) != after.get(name)
    ]


def broken_files(folder: Path) -> list[str]:
    """The files below a folder that are not whole, and the temporary ones; none where there is no such folder."""
    found = []
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = path.relative_to(folder).as_posix()
        if TEMPORARY in path.name or any(part.endswith(TEMPORARY) for part in path.relative_to(folder).parts):
            found.append(f"{name}: temporary")
            continue
        check = _CHECKS.get(path.suffix)
        try:
            whole = path.stat().st_size > 0 if check is None else check(path)
        except (JaxgeoError, ValueError, OSError) as failure:
            found.append(f"{name}: {str(failure).splitlines()[0]}")
            continue
        if not whole:
            found.append(f"{name}: cut off")
    return found


def _whole_json(path: Path) -> bool:
    json.loads(path.read_text(encoding="utf-8"))
    return True


def _whole_csv(path: Path) -> bool:
    """The last row ends with a line feed and has as many commas as the heading: cells here hold none."""
    text = path.read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if not line.startswith("#") and '"' not in line]
    return text.endswith("\n") and rows[0].count(",") == rows[-1].count(",")


def _whole_tum(path: Path) -> bool:
    return len(read_tum(path).stamp_s) > 0 and path.read_bytes().endswith(b"\n")


def _whole_parquet(path: Path) -> bool:
    import pyarrow.parquet

    return pyarrow.parquet.read_table(path).num_rows > 0


def _whole_npz(path: Path) -> bool:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return all(arrays[name] is not None for name in arrays.files)


def _whole_ply(path: Path) -> bool:
    header = read_ply_header(path)
    return sum(map(len, ply_vertices(path, header))) > 0


def _whole_yaml(path: Path) -> bool:
    return bool(read_yaml(path))


def _ends_with(*ends: bytes) -> Callable[[Path], bool]:
    return lambda path: path.read_bytes().rstrip().endswith(ends)


_CHECKS: dict[str, Callable[[Path], bool]] = {
    ".json": _whole_json,
    ".geojson": _whole_json,
    ".csv": _whole_csv,
    ".tum": _whole_tum,
    ".parquet": _whole_parquet,
    ".npz": _whole_npz,
    ".ply": _whole_ply,
    ".yaml": _whole_yaml,
    ".html": _ends_with(b"</html>"),
    ".svg": _ends_with(b"</svg>"),
    ".pdf": _ends_with(b"%%EOF"),
    ".png": _ends_with(b"IEND\xaeB`\x82"),
}
