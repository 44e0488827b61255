"""Which colour and depth images a folder holds: three layouts, recognised by what is there."""

import dataclasses
import re
from pathlib import Path

from jaxgeo.errors import ScanError
from jaxgeo.io.frames.folder import IMAGE_SUFFIXES

COLOUR_FOLDERS = ("color", "rgb", "colour")
DEPTH_FOLDERS = ("depth",)
DEPTH_SUFFIXES = (".png", ".tif", ".tiff", ".pgm")
_SCENES = re.compile(r"(.+)\.(color|depth)$")


@dataclasses.dataclass(frozen=True)
class RgbdFiles:
    """What a folder holds.

    Attributes:
        colour, depth: the images.
        depth_of: colour image -> its depth image, where the names say so; None where the stamps must.
    """

    colour: list[Path]
    depth: list[Path]
    depth_of: dict[Path, Path] | None


def rgbd_files(folder: Path) -> RgbdFiles:
    """List the images of a folder.

    7-Scenes: `NAME.color.jpg|png` beside `NAME.depth.png`. Otherwise `color/` (or `rgb/`, `colour/`) beside `depth/`:
    if all names without their suffixes have a namesake they are partners, else (TUM RGB-D) the stamps tell.

    Raises:
        ScanError: no such folder, or neither layout.
    """
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise ScanError(f"{folder}: {what}, expected a folder of colour and depth images. Check the path.")
    scenes = _scenes(folder)
    if scenes is not None:
        return scenes
    colours = [folder / name for name in COLOUR_FOLDERS if (folder / name).is_dir()]
    depths = [folder / name for name in DEPTH_FOLDERS if (folder / name).is_dir()]
    if len(colours) != 1 or not depths:
        inside = ", ".join(sorted(p.name for p in folder.iterdir())[:8]) or "nothing"
        raise ScanError(
            f"{folder}: neither NAME.color.* beside NAME.depth.png (7-Scenes), nor one of the folders "
            f"{', '.join(COLOUR_FOLDERS)} beside depth. It holds {inside}."
        )
    colour, depth = _images(colours[0], IMAGE_SUFFIXES), _images(depths[0], DEPTH_SUFFIXES)
    by_stem = {file.stem: file for file in depth}
    named = len(colour) == len(depth) and all(file.stem in by_stem for file in colour)
    return RgbdFiles(colour, depth, {file: by_stem[file.stem] for file in colour} if named else None)


def _scenes(folder: Path) -> RgbdFiles | None:
    found: dict[str, dict[str, Path]] = {"color": {}, "depth": {}}
    for file in folder.iterdir():
        match = _SCENES.match(file.stem)
        if match and not file.name.startswith(".") and file.suffix.lower() in IMAGE_SUFFIXES:
            found[match[2]][match[1]] = file
    colour, depth = found["color"], found["depth"]
    if not colour or not depth:
        return None
    both = {file: depth[name] for name, file in colour.items() if name in depth}
    return RgbdFiles(list(colour.values()), list(depth.values()), both)


def _images(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    files = [p for p in folder.iterdir() if p.suffix.lower() in suffixes and not p.name.startswith(".")]
    if not files:
        raise ScanError(f"{folder}: holds no images ({', '.join(suffixes)}).")
    return files
