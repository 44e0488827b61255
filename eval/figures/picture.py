"""One drawn figure, and its bytes in the formats of a web page, a slide and a paper: the same bytes every time."""

import dataclasses
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from jaxgeo.export.figure_style import figure_style
from jaxgeo.io.atomic import output_folder

PNG_DOTS_PER_INCH = 200


@dataclasses.dataclass(frozen=True)
class Picture:
    """A figure made inside `figure_style`; drawn once, written in any format."""

    figure: Figure

    def svg(self) -> bytes:
        """For the report's page."""
        return self._saved("svg", metadata={"Date": None})

    def png(self) -> bytes:
        """At 200 dots to the inch."""
        return self._saved("png", dpi=PNG_DOTS_PER_INCH, metadata={"Software": None})

    def pdf(self) -> bytes:
        """Vectors, fonts embedded, no date."""
        return self._saved("pdf", metadata={"CreationDate": None})

    def _saved(self, form: str, **options: Any) -> bytes:
        buffer = io.BytesIO()
        with figure_style():
            self.figure.savefig(buffer, format=form, **options)
        return buffer.getvalue()


def picture_files(pictures: Mapping[str, Picture]) -> dict[str, bytes]:
    """The bytes of every file by its name: NAME.svg, NAME.png and NAME.pdf of each picture."""
    files = {}
    for name, picture in pictures.items():
        files |= {f"{name}.svg": picture.svg(), f"{name}.png": picture.png(), f"{name}.pdf": picture.pdf()}
    return files


def write_pictures(folder: str | Path, pictures: Mapping[str, Picture]) -> list[Path]:
    """Write `picture_files` into a folder, all or nothing; returns their paths.

    Raises:
        InputError: the folder cannot be written to.
    """
    files = picture_files(pictures)
    with output_folder(folder) as temporary:
        for name, data in files.items():
            (temporary / name).write_bytes(data)
    return [Path(folder) / name for name in files]
