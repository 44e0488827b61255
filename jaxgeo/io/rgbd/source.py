"""Any source of RGB-D frames: the kind is said, or seen from the path."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from jaxgeo.errors import ScanError
from jaxgeo.io.bag_reader import BAG_SUFFIXES
from jaxgeo.io.item_source import OnBad, check_keys, is_bag_folder
from jaxgeo.io.rgbd.bag import BagRgbd
from jaxgeo.io.rgbd.folder import FolderRgbd
from jaxgeo.io.rgbd.rgbd_source import RgbdSource

RgbdKind = Literal["folder", "bag"]
KEYS = {"folder": ("stamps", "rate_hz", "start_s"), "bag": ("topics",)}


def open_rgbd(
    path: str | Path,
    *,
    kind: RgbdKind | None = None,
    stamps: str | Path | None = None,
    rate_hz: float | None = None,
    start_s: float | None = None,
    topics: Mapping[str, str] | None = None,
    depth_unit_m: float = 0.001,
    max_gap_s: float = 0.02,
    on_bad: OnBad = "raise",
) -> RgbdSource:
    """Colour and depth images of a folder or a ROS bag, in pairs; depth lies on the pixels of colour.

    Args:
        path: the folder, the file, or the folder of a ROS 2 bag.
        kind: `folder` or `bag`; default: seen from the path.
        stamps: of a folder: table of stamps and colour images, or one stamp a line; default: `associations.txt` or
            `rgb.txt` in the folder, else the stamps in the names.
        rate_hz: of a folder: frames a second, instead of stamps.
        start_s: stamp of the first frame with `rate_hz`; default 0.
        topics: of a bag: `color` and `depth` -> topic; default: seen from the names of its topics.
        depth_unit_m: metres of one step of a 16-bit depth image (0.0002 for TUM RGB-D's factor 5000).
        max_gap_s: how far apart in time colour and depth may be, where stamps pair them.
        on_bad: `raise` at an unreadable frame, or `skip` it, counted and with a warning.

    Raises:
        ScanError: the path or an argument is unusable; see `FolderRgbd` and `BagRgbd`.
    """
    kind = kind or rgbd_kind_of(path)
    given: dict[str, Any] = {"stamps": stamps, "rate_hz": rate_hz, "start_s": start_s, "topics": topics}
    given = check_keys(path, kind, given, KEYS)
    make = {"folder": FolderRgbd, "bag": BagRgbd}[kind]
    return make(path, depth_unit_m=depth_unit_m, max_gap_s=max_gap_s, on_bad=on_bad, **given)


def rgbd_kind_of(path: str | Path) -> RgbdKind:
    """What a path seems to hold.

    Raises:
        ScanError: no such path, or neither a folder nor a bag.
    """
    path = Path(path)
    if path.is_dir():
        return "bag" if is_bag_folder(path) else "folder"
    if not path.exists():
        raise ScanError(f"{path}: no such file or folder. Check the path (in a config: relative to the config file).")
    if set(path.suffixes) & set(BAG_SUFFIXES):
        return "bag"
    raise ScanError(
        f"{path}: suffix {path.suffix!r}, expected a folder of colour and depth images, or a bag "
        f"({', '.join(BAG_SUFFIXES)})."
    )
