"""Any source of LiDAR scans: the kind is said, or seen from the path."""

from pathlib import Path
from typing import Any, Literal

from jaxgeo.errors import ScanError
from jaxgeo.io.bag_reader import BAG_SUFFIXES
from jaxgeo.io.item_source import OnBad, check_keys, is_bag_folder
from jaxgeo.io.scans.bag import BagScans
from jaxgeo.io.scans.folder import FolderScans
from jaxgeo.io.scans.packed import PackedScans
from jaxgeo.io.scans.scan_file import SCAN_SUFFIXES
from jaxgeo.io.scans.scan_source import ScanSource

ScanKind = Literal["folder", "packed", "bag"]
KEYS = {
    "folder": ("stamps", "rate_hz", "start_s"),
    "packed": ("stamps", "rate_hz", "start_s"),
    "bag": ("topic",),
}


def open_scans(
    path: str | Path,
    *,
    kind: ScanKind | None = None,
    stamps: str | Path | None = None,
    rate_hz: float | None = None,
    start_s: float | None = None,
    topic: str | None = None,
    point_times: bool = True,
    on_bad: OnBad = "raise",
) -> ScanSource:
    """Scans of a folder, a packed file or a ROS bag.

    Args:
        path: the folder, the file, or the folder of a ROS 2 bag.
        kind: `folder`, `packed` or `bag`; default: seen from the path.
        stamps: of a folder or a packed file: one stamp a line, or of a folder a table of stamps and file names;
            default: the stamps in the file names, or the packed file's `times`.
        rate_hz: of these: scans a second, instead of other stamps.
        start_s: stamp of the first scan with `rate_hz`; default 0.
        topic: of a bag: default its only one of point clouds.
        point_times: read the points' times, where there are any; False leaves out what is wrong with them.
        on_bad: `raise` at an unreadable scan, or `skip` it, counted and with a warning.

    Raises:
        ScanError: the path or an argument is unusable; see `FolderScans`, `PackedScans` and `BagScans`.
    """
    kind = kind or scan_kind_of(path)
    given: dict[str, Any] = {"stamps": stamps, "rate_hz": rate_hz, "start_s": start_s, "topic": topic}
    given = check_keys(path, kind, given, KEYS)
    make = {"folder": FolderScans, "packed": PackedScans, "bag": BagScans}[kind]
    return make(path, point_times=point_times, on_bad=on_bad, **given)


def scan_kind_of(path: str | Path) -> ScanKind:
    """What a path seems to hold, by its name and, for a folder, by what lies in it.

    Raises:
        ScanError: no such path, or it is a single scan, or none of the three.
    """
    path = Path(path)
    if path.is_dir():
        return "bag" if is_bag_folder(path) else "folder"
    if not path.exists():
        raise ScanError(f"{path}: no such file or folder. Check the path (in a config: relative to the config file).")
    if path.suffix.lower() == ".npz":
        return "packed"
    if set(path.suffixes) & set(BAG_SUFFIXES):  # x.bag.bz2 is one still to be unpacked
        return "bag"
    if path.suffix.lower() in SCAN_SUFFIXES:
        raise ScanError(
            f"{path}: is a single scan, expected a folder of scans, a packed .npz or a bag. Name its folder."
        )
    raise ScanError(
        f"{path}: suffix {path.suffix!r}, expected a folder of scans, a packed file (.npz), or a bag "
        f"({', '.join(BAG_SUFFIXES)})."
    )
