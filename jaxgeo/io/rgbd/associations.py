"""TUM RGB-D's `associations.txt`: which colour and depth images belong together, and when they were taken."""

import dataclasses
from pathlib import Path

from jaxgeo.errors import ScanError
from jaxgeo.io.item_stamps import increasing_stamps
from jaxgeo.io.named_file import is_there
from jaxgeo.io.text_table import read_table, text_column


@dataclasses.dataclass(frozen=True)
class ImagePair:
    """A colour image, its stamp and its depth image."""

    stamp_s: float
    colour: Path
    depth: Path


def read_associations(path: Path) -> list[ImagePair]:
    """Read rows of stamp, colour image, stamp, depth image (or depth first: what lies in `depth/` is depth).

    Raises:
        ScanError: with line: other columns, a stamp that is no number, stamps that do not increase, a missing image.
    """
    table = read_table(path, error=ScanError)
    if table.n_columns != 4:
        raise ScanError(
            f"{table.place(0)}: {table.n_columns} columns, expected stamp, colour image, stamp, depth image. Give "
            "`stamps`, or remove the file to pair by stamps."
        )
    depth_first = text_column(table, 1)[0].startswith("depth")
    stamp, colour, depth = (2, 3, 1) if depth_first else (0, 1, 3)
    stamp_s = increasing_stamps(table, stamp)
    pairs = []
    names = zip(text_column(table, colour), text_column(table, depth), strict=True)
    for row, (stamp_of_pair_s, files) in enumerate(zip(stamp_s.tolist(), names, strict=True)):
        absent = next((name for name in files if not is_there(path.parent / name)), None)
        if absent is not None:
            raise ScanError(
                f"{table.place(row)}: names {absent!r:.80}, which is not in {path.parent}. Copy it, or remove the row."
            )
        pairs.append(ImagePair(stamp_of_pair_s, path.parent / files[0], path.parent / files[1]))
    return pairs
