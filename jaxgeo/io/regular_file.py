"""What is opened for reading must be a file on disk, and not larger than its kind can be."""

import os
import stat
from pathlib import Path

from jaxgeo.errors import InputError

# Of a file that is read into memory whole: a table of some ten million rows, an image of some hundred megapixels.
MOST_BYTES = 1 << 30
_HEAD_BYTES = 1 << 16


def check_regular(path: str | Path, error: type[InputError] = InputError, most_bytes: int | None = None) -> None:
    """Refuse what is no file (a device never ends, a pipe may never begin), and a file above `most_bytes`.

    Of a missing file and of a folder it says nothing: their readers do.

    Raises:
        error: with the path, and the size.
    """
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return
    if stat.S_ISDIR(status.st_mode):
        return
    if not stat.S_ISREG(status.st_mode):
        raise error(f"{path}: is a device or a pipe, expected a file. Save it as a file, and name that.")
    if most_bytes is not None and status.st_size > most_bytes:
        raise error(
            f"{path}: {status.st_size:,} bytes, expected at most {most_bytes:,} of a file of this kind. Is it another "
            "file, or damaged? Name the right one, or split it."
        )


def read_whole(path: str | Path, error: type[InputError] = InputError, most_bytes: int = MOST_BYTES) -> bytes:
    """All bytes of a file.

    Raises:
        error: no regular file, or above `most_bytes`.
        OSError: missing, a folder, or not readable.
    """
    check_regular(path, error, most_bytes)
    return Path(path).read_bytes()


def head_of(path: str | Path, error: type[InputError] = InputError) -> bytes:
    """The first bytes of a file of any size: enough to see that it is of another kind.

    Raises:
        error: no regular file.
        OSError: missing, a folder, or not readable.
    """
    check_regular(path, error)
    with Path(path).open("rb") as file:
        return file.read(_HEAD_BYTES)
