"""The files of a study: every table and figure in its formats."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from eval.figures.picture import picture_files
from eval.study_page import StudyFigure
from jaxgeo.export.table import Table, table_files


def study_files(tables: Sequence[Table], figures: Sequence[StudyFigure]) -> dict[str, str | bytes]:
    """By path below the study's folder: tables/NAME.csv, .md, .tex and figures/NAME.svg, .png, .pdf."""
    files: dict[str, str | bytes] = {f"tables/{name}": text for name, text in table_files(tables).items()}
    pictures = {each.name: each.picture for each in figures}
    return files | {f"figures/{name}": data for name, data in picture_files(pictures).items()}


def put_files(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write files by their path below an existing folder (a temporary one: `jaxgeo.io.atomic.output_folder`)."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_text(content, encoding="utf-8", newline="\n")
