"""Files and folders that appear whole or not at all."""

import contextlib
import errno
import fcntl
import os
import re
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

from jaxgeo.errors import InputError

_NO_PLACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextlib.contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary file beside `path`, put in its place when the block ends well and removed when it does not.

    The temporary name keeps the suffix, since many writers choose their format by it. A link is followed.

    Raises:
        InputError: the folder does not exist or cannot be written to, `path` is a folder, or the disk is full.
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
    except OSError as failure:
        _refuse_full(path, failure)
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def output_folder(folder: str | Path) -> Iterator[Path]:
    """A temporary folder beside `folder`, whose files are moved there when the block ends well.

    A folder that does not exist yet appears in one step; in one that does, the files replace their namesakes one by one
    and the others are left alone. When the block fails, nothing is moved. What an earlier process left that was killed
    outright is removed first.

    Raises:
        InputError: `folder` is a file, its parent cannot be written to, a file would replace a folder, or the disk is
            full.
    """
    check_output_folder(folder)
    target = Path(os.path.realpath(folder))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_orphans(target)
        temporary, claim = _claimed_folder(target)
    except OSError as failure:
        raise InputError(f"{folder}: cannot write into {target.parent}: {failure.strerror}.") from None
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        files = [file for file in temporary.rglob("*") if file.is_file()]
        for file in files:
            _sync(file)
        with _uninterrupted():
            if target.exists():
                _move_into(target, temporary, files)
            else:
                os.replace(temporary, target)
            _sync(target.parent)
    except OSError as failure:
        _refuse_full(folder, failure)
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        os.close(claim)


def check_output_folder(folder: str | Path) -> None:
    """Refuse an output folder that cannot be written to: better before a long computation than after it.

    Raises:
        InputError: it, or the nearest folder above it that exists, is a file or not writable.
    """
    target = Path(os.path.realpath(folder))
    place = next(p for p in (target, *target.parents) if os.path.lexists(p))
    if not place.is_dir():
        what = "is a file" if place == target else f"{place} is a file"
        raise InputError(f"{folder}: {what}, expected a folder to write into. Name another folder.")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: cannot write into {place}: Permission denied. Name another folder.")


def write_lines(path: str | Path, lines: Iterable[str]) -> None:
    """Write a text file (UTF-8, line feeds), whole or not at all."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"{line}\n" for line in lines)


def _claimed_folder(target: Path) -> tuple[Path, int]:
    """A new temporary folder, and the open handle whose lock says that its process lives: the lock dies with it."""
    while True:
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp"))
        claim = os.open(temporary, os.O_RDONLY)
        try:
            fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:  # another process took it for an orphan, just now
            os.close(claim)
            continue
        except OSError:  # a file system without locks: nothing is ever taken for an orphan there
            return temporary, claim
        if temporary.is_dir():
            return temporary, claim
        os.close(claim)


def _remove_orphans(target: Path) -> None:
    """Remove temporary folders of processes that are gone; what cannot be locked or removed stays."""
    ours = re.compile(rf"\.{re.escape(target.name)}\.[a-z0-9_]{{8}}\.tmp")
    for path in [p for p in target.parent.iterdir() if ours.fullmatch(p.name) and p.is_dir() and not p.is_symlink()]:
        with contextlib.suppress(OSError):
            claim = os.open(path, os.O_RDONLY)
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path)
            finally:
                os.close(claim)


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


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Interrupts and terminations wait until the block is done: half of the files moved is what must not be left."""
    if threading.current_thread() is not threading.main_thread():  # only there can signals be caught
        yield
        return
    came: list[int] = []
    kept = {number: signal.signal(number, lambda n, _: came.append(n)) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
    for number in came:
        signal.raise_signal(number)


def _refuse_full(path: str | Path, failure: OSError) -> None:
    """Say where there is no place: a failing write does not name its file."""
    if failure.errno in _NO_PLACE:
        raise InputError(
            f"{path}: cannot be written: {failure.strerror}. Nothing of it was kept: free some space, or name another "
            "place."
        ) from None


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
