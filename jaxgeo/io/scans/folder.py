"""Folders of scans, one scan a file."""

import functools
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxgeo.data import Scan
from jaxgeo.errors import ScanError
from jaxgeo.io.item_source import OnBad
from jaxgeo.io.item_stamps import check_stamp_choice, stamped_files
from jaxgeo.io.scans.columns import scan_of_columns
from jaxgeo.io.scans.scan_file import SCAN_SUFFIXES, read_scan_file
from jaxgeo.io.scans.scan_source import ScanSource


class FolderScans(ScanSource):
    """The scans of a folder, by stamp. Making it lists the folder and reads the stamps; scans are read one by one."""

    def __init__(
        self,
        path: str | Path,
        *,
        stamps: str | Path | None = None,
        rate_hz: float | None = None,
        start_s: float | None = None,
        point_times: bool = True,
        on_bad: OnBad = "raise",
    ) -> None:
        """List the scans and their stamps.

        Args:
            path: the folder of `.ply`, `.pcd`, `.bin` (KITTI), `.npz` or `.npy` files, all of one kind.
            stamps, rate_hz, start_s: see `stamped_files`; default: the stamps in the file names.
            point_times: read the points' times, where there are any.
            on_bad: also of scans that the table of stamps names and that are missing.

        Raises:
            ScanError: no folder, no scans, several kinds of files, no stamps, or stamps that do not fit.

        Warns:
            InputWarning: of scans that have no stamp; they are left out.
        """
        self._path = Path(path)
        self._point_times = point_times
        check_stamp_choice(path, stamps, rate_hz, start_s)
        files = _scans_in(self._path)
        self._rows = stamped_files(
            self._path, files, stamps=stamps, rate_hz=rate_hz, start_s=start_s, noun="scan", on_bad=on_bad
        )
        super().__init__(len(self._rows), on_bad)

    def _entries(self, start: int) -> Iterator[tuple[int, Callable[[], Scan]]]:
        for index in range(start, len(self._rows)):
            yield index, functools.partial(self._scan, index)

    def _scan(self, index: int) -> Scan:
        row = self._rows[index]
        columns = read_scan_file(row.file)
        return scan_of_columns(columns, row.stamp_s, str(row.file), index, point_times=self._point_times)

    def _name(self) -> str:
        return str(self._path)


def _scans_in(folder: Path) -> list[Path]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise ScanError(f"{folder}: {what}, expected a folder of scans. Check the path, or is the kind another one?")
    files = [p for p in folder.iterdir() if p.suffix.lower() in SCAN_SUFFIXES and not p.name.startswith(".")]
    if not files:
        below = next((p.name for p in sorted(folder.iterdir()) if p.is_dir()), None)
        hint = f" Are they in a folder below, such as {below!r}?" if below else ""
        raise ScanError(f"{folder}: holds no scans ({', '.join(SCAN_SUFFIXES)}).{hint}")
    kinds = Counter(file.suffix.lower() for file in files)
    if len(kinds) > 1:
        found = ", ".join(f"{n} {suffix}" for suffix, n in kinds.most_common())
        raise ScanError(
            f"{folder}: holds files of several kinds ({found}), expected scans of one kind. Move the others elsewhere."
        )
    return files
