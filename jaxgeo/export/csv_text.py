"""Comma-separated text as all our files have it: `#` comment lines, one header line, numbers that read back exactly."""

import csv
import io
from collections.abc import Iterable, Sequence

from jaxgeo.export.result import SessionResult


def csv_text(comments: Sequence[str], columns: Sequence[str], rows: Iterable[Sequence]) -> str:
    """The table as text. Floats keep every digit they need to read back the same; None and NaN are left empty."""
    buffer = io.StringIO()
    buffer.writelines(f"# {one_line(c)}\n" for c in comments)
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    # x != x holds for NaN alone; csv itself writes floats by repr, which reads back exactly
    writer.writerows([None if x != x else x for x in row] for row in rows)
    return buffer.getvalue()


def heading(result: SessionResult, what: str) -> list[str]:
    """The comment lines that every table starts with: what it is, whose, and in which coordinates."""
    frame = result.frame
    lines = ["SIMULATED DATA: not a measurement"] if result.simulated else []
    east, north, height = (repr(float(x)) for x in frame.origin_enh_m)
    return [
        *lines,
        f"jaxgeo {what}",
        f"session: {result.name}",
        f"crs: {frame.crs} ({frame.crs_name}); height: {frame.height}",
        f"local frame = grid minus origin; origin E={east} N={north} h={height} m",
    ]


def one_line(text: str) -> str:
    """User text without line breaks, so that it cannot leave its comment line."""
    return " ".join(str(text).split())
