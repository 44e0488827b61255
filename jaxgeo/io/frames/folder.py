"""Folders of images, stamped by a table, by their names, or by a rate."""

import functools
import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxgeo.errors import DetectError
from jaxgeo.io.frames.frame import DEFAULT_CAMERA, Frame, FrameSource, OnBad, UnreadableImageError
from jaxgeo.io.frames.pixels import decoded_image
from jaxgeo.io.frames.stamp_table import StampRow, read_stamp_table
from jaxgeo.io.frames.stamps import check_rate, stamp_in_name
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.named_file import is_there
from jaxgeo.io.regular_file import read_whole

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")


class FolderFrames(FrameSource):
    """The images of a folder, by stamp. Making it lists the folder and reads the table; images are read one by one."""

    def __init__(
        self,
        path: str | Path,
        *,
        stamps: str | Path | None = None,
        rate_hz: float | None = None,
        start_s: float | None = None,
        camera: str | None = None,
        on_bad: OnBad = "raise",
    ) -> None:
        """List the images and their stamps.

        Args:
            path: the folder. File names in a table count from it, or else from the table's own folder.
            stamps: the table (see `read_stamp_table`); default: the stamps in the file names (see `stamp_in_name`).
            rate_hz: images a second, in the natural order of their names (img2 before img10), instead of stamps.
            start_s: stamp of the first image with `rate_hz`; default 0.
            camera: the camera of images whose table names none; default `cam0`.
            on_bad: also of images that the table names and that are missing.

        Raises:
            DetectError: no folder, no images, no stamps; table and folder do not fit; two images of one camera have
                one stamp.

        Warns:
            InputWarning: of images that have no stamp; they are left out.
        """
        self._path = Path(path)
        camera = camera or DEFAULT_CAMERA
        check_rate(path, rate_hz, start_s)
        if stamps is not None and rate_hz is not None:
            raise DetectError(f"{path}: both `stamps` and `rate_hz` say when images were taken. Give one of them.")
        if start_s is not None and rate_hz is None:
            raise DetectError(f"{path}: `start_s` is the stamp of the first image at `rate_hz`: give that too.")
        images = _images_in(self._path, empty_allowed=stamps is not None)
        if stamps is not None:
            rows = _rows_of_table(self._path, stamps, images, on_bad)
        elif rate_hz is not None:
            first_s = start_s or 0.0
            rows = [StampRow(first_s + i / rate_hz, str(p), None, str(p)) for i, p in enumerate(images)]
        else:
            rows = _rows_of_names(self._path, images)
        self._rows = sorted(rows, key=lambda row: row.stamp_s)
        self._camera = camera
        _check_distinct(self._rows)
        cameras = tuple(sorted({row.camera or camera for row in rows}))
        super().__init__(cameras, len(rows), on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Frame]]]:
        for index in range(start, len(self._rows)):
            yield index, functools.partial(self._frame, index)

    def _frame(self, index: int) -> Frame:
        row = self._rows[index]
        try:
            data = read_whole(row.file, UnreadableImageError)
        except FileNotFoundError:
            named = f" ({row.place} names it)" if row.place != row.file else ""
            raise UnreadableImageError(f"{row.file}: no such file{named}. Was it moved or not copied?") from None
        except OSError as failure:
            raise UnreadableImageError(f"{row.file}: cannot be read: {failure.strerror}.") from None
        return Frame(row.stamp_s, row.camera or self._camera, row.file, index, decoded_image(data, row.file))

    def _name(self) -> str:
        return str(self._path)


def natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """Sorts img2 before img10; the name itself breaks ties such as 01 and 1."""
    parts = re.split(r"(\d+)", name)
    # Odd parts are digits; by length then text they sort as numbers do
    return [(len(p.lstrip("0")), p.lstrip("0")) if i % 2 else (0, p) for i, p in enumerate(parts)], name


def _images_in(folder: Path, empty_allowed: bool) -> list[Path]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise DetectError(f"{folder}: {what}, expected a folder of images. Check the path, or is the kind another one?")
    images = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".")]
    if not images and not empty_allowed:
        below = next((p.name for p in sorted(folder.iterdir()) if p.is_dir()), None)
        hint = f" Are they in a folder below, such as {below!r}?" if below else ""
        raise DetectError(f"{folder}: holds no images ({', '.join(IMAGE_SUFFIXES)}).{hint}")
    return sorted(images, key=lambda p: natural_key(p.name))


def _rows_of_table(folder: Path, stamps: str | Path, images: list[Path], on_bad: OnBad) -> list[StampRow]:
    rows, missing = [], []
    for row in read_stamp_table(stamps):
        file = _place_of(row.file, folder, Path(stamps).parent)
        if file is None:
            missing.append(row)
        rows.append(StampRow(row.stamp_s, str(file or folder / row.file), row.camera, row.place))
    if missing and (on_bad == "raise" or len(missing) == len(rows)):
        raise DetectError(
            f"{missing[0].place}: names {missing[0].file!r:.80}, which is not in {folder}; {len(missing)} of the "
            f"{len(rows)} rows name missing images. Is this the table of another folder? Copy the images, or remove "
            "their rows."
        )
    named = {Path(row.file).name for row in rows}
    _warn_of_unstamped(folder, [p for p in images if p.name not in named], len(images), f"are not in {stamps}")
    return rows


def _place_of(name: str, folder: Path, beside: Path) -> Path | None:
    """Where an image of a table lies; None where it is missing."""
    return next((place for place in (folder / name, beside / name) if is_there(place)), None)


def _rows_of_names(folder: Path, images: list[Path]) -> list[StampRow]:
    stamped = [(stamp_in_name(p), p) for p in images]
    rows = [StampRow(stamp_s, str(p), None, str(p)) for stamp_s, p in stamped if stamp_s is not None]
    if not rows:
        raise DetectError(
            f"{images[0]}: the name holds no stamp: expected seconds with decimals (1305031102.175304) or nanoseconds "
            "(18 or 19 digits) at its end. Give a table (`stamps`: stamp_s,file), or `rate_hz` for images a second."
        )
    _warn_of_unstamped(folder, [p for stamp, p in stamped if stamp is None], len(images), "have no stamp in their name")
    return rows


def _warn_of_unstamped(folder: Path, without: list[Path], total: int, why: str) -> None:
    if without:
        warnings.warn(
            f"{folder}: {len(without)} of {total} images {why} and are left out; the first is {without[0].name}.",
            InputWarning,
            stacklevel=5,
        )


def _check_distinct(rows: list[StampRow]) -> None:
    by_stamp: dict[tuple[float, str | None], StampRow] = {}
    by_file: dict[str, StampRow] = {}
    for row in rows:
        other = by_stamp.setdefault((row.stamp_s, row.camera), row)
        if other is not row:
            raise DetectError(
                f"{row.place}: {Path(row.file).name} has the stamp {row.stamp_s!r} s of {Path(other.file).name} "
                f"({other.place}). One camera takes one image at a time: name the cameras in a column `camera`, or "
                "mend the stamp."
            )
        other = by_file.setdefault(row.file, row)
        if other is not row:
            raise DetectError(f"{row.place}: {row.file} is named a second time, first in {other.place}. Keep one row.")
