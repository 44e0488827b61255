"""Folders of RGB-D frames: a colour and a depth image each."""

import functools
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxgeo.data import RgbdFrame
from jaxgeo.errors import ScanError
from jaxgeo.io.frames.pixels import decoded_image
from jaxgeo.io.item_source import OnBad, raised_as
from jaxgeo.io.item_stamps import StampedFile, check_stamp_choice, stamped_files
from jaxgeo.io.regular_file import read_whole
from jaxgeo.io.rgbd.associations import ImagePair, read_associations
from jaxgeo.io.rgbd.depth import check_depth_unit, depth_of_file
from jaxgeo.io.rgbd.layout import RgbdFiles, rgbd_files
from jaxgeo.io.rgbd.pairs import check_gap, check_paired, nearest_pairs
from jaxgeo.io.rgbd.rgbd_source import RgbdSource, UnreadableFrameError, frame_of_images


class FolderRgbd(RgbdSource):
    """The frames of a folder, by stamp. Making it lists the folder and reads the stamps; images are read one by one."""

    def __init__(
        self,
        path: str | Path,
        *,
        stamps: str | Path | None = None,
        rate_hz: float | None = None,
        start_s: float | None = None,
        depth_unit_m: float = 0.001,
        max_gap_s: float = 0.02,
        on_bad: OnBad = "raise",
    ) -> None:
        """List the images, their stamps and who belongs to whom.

        Args:
            path: the folder; for its layouts see `rgbd_files`.
            stamps, rate_hz, start_s: of the colour images, see `stamped_files`; default: the table `rgb.txt` (TUM
                RGB-D) beside `rgb`, else the stamps in their names.
            depth_unit_m: metres of one step of a 16-bit depth image.
            max_gap_s: how far apart in time colour and depth may be, where stamps pair them and not names.
            on_bad: also of images that a table names and that are missing.

        Raises:
            ScanError: no such folder, no known layout, no pairs, or stamps that do not fit.

        Warns:
            InputWarning: of images without a partner or a stamp; they are left out.
        """
        self._path = Path(path)
        self._depth_unit_m = depth_unit_m
        check_stamp_choice(path, stamps, rate_hz, start_s)
        check_depth_unit(path, depth_unit_m)
        check_gap(path, max_gap_s)
        files = rgbd_files(self._path)
        associations = self._path / "associations.txt"
        if stamps is None and rate_hz is None and associations.is_file():
            self._pairs = read_associations(associations)
        else:
            table = self._path / "rgb.txt"
            if stamps is None and rate_hz is None and table.is_file():
                stamps = table
            self._pairs = self._paired(files, stamps, rate_hz, start_s, max_gap_s, on_bad)
        super().__init__(len(self._pairs), on_bad)

    def _paired(
        self,
        files: RgbdFiles,
        stamps: str | Path | None,
        rate_hz: float | None,
        start_s: float | None,
        max_gap_s: float,
        on_bad: OnBad,
    ) -> list[ImagePair]:
        if files.depth_of is None:
            if rate_hz is not None:
                raise ScanError(
                    f"{self._path}: {len(files.colour)} colour and {len(files.depth)} depth images of different names: "
                    "which belong together only stamps can tell, not `rate_hz`. Give them equal names, or stamps."
                )
            colour = self._stamped(files.colour, stamps, None, None, on_bad)
            depth_table = self._path / "depth.txt"
            depth = self._stamped(files.depth, depth_table if depth_table.is_file() else None, None, None, on_bad)
            both = list(nearest_pairs(colour, depth, max_gap_s))
            pairs = [ImagePair(one.stamp_s, one.file, other.file) for one, other in both if one and other]
            n_colour, n_depth = len(colour), len(depth)
            within = f" within {max_gap_s:g} s"
        else:
            depth_of = files.depth_of
            # All colour images take part, so that a rate and a list count those without depth too
            colour = self._stamped(files.colour, stamps, rate_hz, start_s, on_bad)
            pairs = [ImagePair(row.stamp_s, row.file, depth_of[row.file]) for row in colour if row.file in depth_of]
            n_colour, n_depth = len(colour), len(files.depth)
            within = " of the same name"
        check_paired(self._path, n_colour, n_depth, len(pairs), within)
        return pairs

    def _stamped(
        self, files: list[Path], stamps: str | Path | None, rate_hz: float | None, start_s: float | None, on_bad: OnBad
    ) -> list[StampedFile]:
        return stamped_files(
            self._path, files, stamps=stamps, rate_hz=rate_hz, start_s=start_s, noun="image", on_bad=on_bad
        )

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], RgbdFrame]]]:
        for index in range(start, len(self._pairs)):
            yield index, functools.partial(self._frame, index)

    def _frame(self, index: int) -> RgbdFrame:
        pair = self._pairs[index]
        try:
            data = read_whole(pair.colour, UnreadableFrameError)
        except FileNotFoundError:
            raise UnreadableFrameError(f"{pair.colour}: no such file. Was it moved or not copied?") from None
        except OSError as failure:
            raise UnreadableFrameError(f"{pair.colour}: cannot be read: {failure.strerror}.") from None
        with raised_as(UnreadableFrameError):
            image = decoded_image(data, str(pair.colour))
        depth_m = depth_of_file(pair.depth, self._depth_unit_m)
        return frame_of_images(pair.stamp_s, image, depth_m, str(pair.colour), index)

    def _name(self) -> str:
        return str(self._path)
