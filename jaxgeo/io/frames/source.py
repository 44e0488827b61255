"""Any source of images: the kind is said, or seen from the path."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from jaxgeo.errors import DetectError
from jaxgeo.io.frames.bag import BagFrames
from jaxgeo.io.frames.folder import IMAGE_SUFFIXES, FolderFrames
from jaxgeo.io.frames.frame import FrameSource, OnBad
from jaxgeo.io.frames.video import VideoFrames

Kind = Literal["folder", "video", "bag"]
BAG_SUFFIXES = (".bag", ".mcap", ".db3")
KEYS = {
    "folder": ("stamps", "rate_hz", "start_s", "camera"),
    "video": ("rate_hz", "start_s", "camera"),
    "bag": ("topics", "camera"),
}


def open_frames(
    path: str | Path,
    *,
    kind: Kind | None = None,
    stamps: str | Path | None = None,
    rate_hz: float | None = None,
    start_s: float | None = None,
    topics: Mapping[str, str] | None = None,
    camera: str | None = None,
    on_bad: OnBad = "raise",
) -> FrameSource:
    """Images of a folder, a video file or a ROS bag.

    Args:
        path: the folder, the file, or the folder of a ROS 2 bag.
        kind: `folder`, `video` or `bag`; default: seen from the path.
        stamps: of a folder: table of stamps and file names; default: stamps in the file names.
        rate_hz: of a folder or a video: images a second, instead of other stamps.
        start_s: stamp of the first image (with `rate_hz`), or of the zero of a video's own time; default 0.
        topics: of a bag: topic -> camera; default: its only image topic.
        camera: the camera of what names none; default `cam0`.
        on_bad: `raise` at an unreadable image, or `skip` it, counted and with a warning.

    Raises:
        DetectError: the path or an argument is unusable; see the three kinds.
    """
    kind = kind or kind_of(path)
    if kind not in KEYS:
        raise DetectError(f"{path}: kind {kind!r}, expected one of {', '.join(KEYS)}.")
    given: dict[str, Any] = {"stamps": stamps, "rate_hz": rate_hz, "start_s": start_s, "topics": topics}
    given = {key: value for key, value in given.items() if value is not None} | {"camera": camera}
    for key in given:
        if key not in KEYS[kind]:
            raise DetectError(
                f"{path}: {key!r} says nothing about a source of kind {kind!r}, which has {', '.join(KEYS[kind])}. "
                "Remove it, or is the kind another one?"
            )
    make = {"folder": FolderFrames, "video": VideoFrames, "bag": BagFrames}[kind]
    return make(path, on_bad=on_bad, **given)


def kind_of(path: str | Path) -> Kind:
    """What a path seems to hold, by its name and, for a folder, by what lies in it.

    Raises:
        DetectError: no such path, or it is a single image.
    """
    path = Path(path)
    if path.is_dir():
        bag = (path / "metadata.yaml").exists() or any(path.glob("*.mcap")) or any(path.glob("*.db3"))
        return "bag" if bag else "folder"
    if not path.exists():
        raise DetectError(f"{path}: no such file or folder. Check the path (in a config: relative to the config file).")
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise DetectError(f"{path}: is a single image, expected a folder of images, a video or a bag. Name its folder.")
    return "bag" if set(path.suffixes) & set(BAG_SUFFIXES) else "video"  # x.bag.bz2 is one still to be unpacked
