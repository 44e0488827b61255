"""Files that a table names."""

from pathlib import Path


def is_there(path: Path) -> bool:
    """Whether a file lies there; what is no name at all (too long, with a zero byte) is not there either."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
