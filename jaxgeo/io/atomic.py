"""Files and folders that appear whole or not at all."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from jaxgeo.errors import InputError


@contextlib.contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary file beside `path`, put in its place when the block ends well and removed when it does not.

    The temporary name keeps the suffix, since many writers choose their format by it. A link is followed.

    Raises:
        InputError: the folder does not exist or cannot be written to, or `path` is a folder.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: is a folder, expected the name of a file to write.")
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.stem}.", suffix=f".tmp{target.suffix}")
    except OSError as failure:
        raise InputError(f"{path}: cannot write into {target.parent}: {failure.strerror}.") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
        _sync(temporary)
        os.replace(temporary, target)
        _sync(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def output_folder(folder: str | Path) -> Iterator[Path]:
    """A temporary folder beside `folder`, whose files are moved there when the block ends well.

    A folder that does not exist yet appears in one step; in one that does, the files replace their namesakes one by one
    and the others are left alone. When the block fails, nothing is moved.

    Raises:
        InputError: `folder` is a file, its parent cannot be written to, or a file would replace a folder.
    """
    target = Path(os.path.realpath(folder))
    if target.exists() and not target.is_dir():
        raise InputError(f"{folder}: is a file, expected a folder to write into.")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp"))
    except OSError as failure:
        raise InputError(f"{folder}: cannot write into {target.parent}: {failure.strerror}.") from None
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        files = [file for file in temporary.rglob("*") if file.is_file()]
        for file in files:
            _sync(file)
        if target.exists():
            _move_into(target, temporary, files)
        else:
            os.replace(temporary, target)
        _sync(target.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_lines(path: str | Path, lines: Iterable[str]) -> None:
    """Write a text file (UTF-8, line feeds), whole or not at all."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"{line}\n" for line in lines)


def _move_into(target: Path, temporary: Path, files: list[Path]) -> None:
    moves = [(file, target / file.relative_to(temporary)) for file in files]
    for _, place in moves:  # all checks before the first move
        if place.is_dir():
            raise InputError(f"{place}: is a folder, but a file of this name is to be written there.")
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError as failure:
            raise InputError(f"{place.parent}: cannot be made a folder: {failure.strerror}.") from None
    for file, place in moves:
        os.replace(file, place)
    _sync(target)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _sync(path: Path) -> None:
    """Bring a file or folder to disk, so that the rename cannot overtake its content."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
