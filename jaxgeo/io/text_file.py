"""The lines of a text file, or one clear message why there are none."""

from pathlib import Path

from jaxgeo.errors import InputError
from jaxgeo.io.regular_file import head_of, read_whole


def read_lines(path: str | Path, error: type[InputError] = InputError) -> list[str]:
    """All lines of a UTF-8 text file, without line ends; a byte order mark is dropped.

    Raises:
        error: the file is missing, a folder, a device, unreadable, empty, not text, or too large to be held in memory.
    """
    try:
        head = head_of(path, error)
        if b"\0" in head:  # before its size: a large file is rather of another kind than a large table
            raise error(_not_text(path, head, head.index(0)))
        data = read_whole(path, error)
    except FileNotFoundError:
        raise error(f"{path}: no such file. Check the path (in a config: relative to the config file).") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder, expected a text file. Name the file in it.") from None
    except OSError as failure:
        raise error(f"{path}: cannot be read: {failure.strerror}.") from None
    if not data.strip():
        raise error(f"{path}: the file is empty. Was writing it cut off? Make it anew, or name another.")
    zero = data.find(b"\0")
    if zero >= 0:
        raise error(_not_text(path, data, zero))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        raise error(_not_text(path, data, failure.start)) from None
    # Not str.splitlines: it also splits at form feeds and other marks, which would shift the line numbers.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _not_text(path: str | Path, data: bytes, at: int) -> str:
    head = data[:at]
    line = head.count(b"\n") + 1
    return (
        f"{path}:{line}: byte 0x{data[at]:02x} is not UTF-8 text. Is this a binary or compressed file, or a table "
        "saved in another encoding? Save it as plain text (UTF-8)."
    )
