"""Orthophotos: the part of a GeoTIFF that a map shows, in the map's own coordinates. rasterio lives here."""

import contextlib
import dataclasses
import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from jaxgeo.errors import InputError
from jaxgeo.io.regular_file import check_regular

Bounds = tuple[float, float, float, float]  # west, south, east, north
_WARP_ACCURACY_PX = 0.125  # of GDAL's approximation of the exact transformation, of a pixel shown


@dataclasses.dataclass(frozen=True)
class Orthophoto:
    """A picture of the ground, north up.

    Attributes:
        rgba: (h, w, 4) red, green, blue, opacity, 0 to 255; the first row is the northern one. What the file does not
            know or does not cover is transparent.
        bounds_en_m: west, south, east, north: outer edges of the outer pixels, grid coordinates.
    """

    rgba: UInt8[np.ndarray, "h w 4"]
    bounds_en_m: Bounds


def read_orthophoto(path: str | Path, crs: str, bounds_en_m: Bounds, most_px: int = 2000) -> Orthophoto:
    """The part of a GeoTIFF inside a box, at most `most_px` pixels a side; pixels are square.

    Only that part is read, at no more than the file's own resolution, and warped (bilinear) where the file has another
    CRS or is not north-up. One band is grey, or coloured by the file's palette; with three or more the first three are
    red, green and blue. Bands of 16 bits and floats are stretched between the 2nd and 98th percentile of what is
    shown, all colours alike.

    Args:
        crs: of `bounds_en_m` and of the result: `EPSG:<code>` or WKT, without a vertical part.
        bounds_en_m: west, south, east, north in that CRS, east first whatever its register says.

    Raises:
        InputError: rasterio is not installed; no such file, not a raster; no CRS or place in it; it does not overlap
            the box; its values are not colours.
    """
    rasterio = _rasterio()
    from rasterio.enums import Resampling
    from rasterio.vrt import WarpedVRT
    from rasterio.warp import transform_bounds

    target = rasterio.crs.CRS.from_user_input(crs)
    with _opened(rasterio, path) as source:
        _check_place(path, source)
        # The box of a rotated or warped file is larger than what it covers: transparent corners, no harm
        with _in_words(rasterio, path):
            covered = transform_bounds(source.crs, target, *_box(source), densify_pts=21)
        box = _overlap(path, bounds_en_m, covered)
        with _in_words(rasterio, path):
            width, height = _size(path, source, target, box, bounds_en_m, most_px)
        place = rasterio.transform.from_bounds(*box, width, height)
        view = {"crs": target, "transform": place, "width": width, "height": height, "tolerance": _WARP_ACCURACY_PX}
        has_alpha = rasterio.enums.ColorInterp.alpha in source.colorinterp
        palette = _palette(source)
        how = Resampling.nearest if palette is not None else Resampling.bilinear
        # GDAL reads as little as the view needs, from overviews where the file has them
        with (
            _readable(rasterio, path),
            WarpedVRT(source, resampling=how, add_alpha=not has_alpha, **view) as warped,
        ):
            value = warped.read(_colour_bands(source))
            # Float files mark gaps by NaN, with or without saying so
            opacity = np.where(np.isfinite(value).all(axis=0), warped.dataset_mask(), 0)
    rgb = palette[value[0]] if palette is not None else np.moveaxis(_bytes(path, value, opacity > 0), 0, -1)
    rgb = np.broadcast_to(rgb[..., :3], (height, width, 3))
    return Orthophoto(np.dstack([rgb, opacity]).astype(np.uint8), box)


def _rasterio() -> Any:
    try:
        import rasterio
        import rasterio.enums
        import rasterio.transform
    except ImportError:
        raise InputError(
            "an orthophoto needs the package rasterio, which is not installed: pip install 'jaxgeo[maps]', or remove "
            "`basemap` from the config."
        ) from None
    return rasterio


def _opened(rasterio: Any, path: str | Path) -> Any:
    if not Path(path).exists():
        raise InputError(f"{path}: no such file. Check the path (in a config: relative to the config file).")
    check_regular(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)  # refused below, in our words
            return rasterio.open(path)
    except (rasterio.errors.RasterioIOError, UnicodeDecodeError):  # the latter of damaged names
        raise InputError(f"{path}: is not a raster that GDAL can read; expected a GeoTIFF (.tif).") from None


@contextlib.contextmanager
def _readable(rasterio: Any, path: str | Path) -> Iterator[None]:
    try:
        yield
    except rasterio.errors.RasterioError as failure:
        raise InputError(f"{path}: its pixels cannot be read ({failure}). Is the file whole?") from None


@contextlib.contextmanager
def _in_words(rasterio: Any, path: str | Path) -> Iterator[None]:
    """Refuse a file whose place GDAL cannot put into the box's system."""
    from rasterio._err import CPLE_BaseError  # what GDAL says of coordinates rasterio passes on as it is

    try:
        yield
    except (rasterio.errors.RasterioError, CPLE_BaseError) as failure:
        raise InputError(
            f"{path}: its coordinate system or its place cannot be used ({' '.join(str(failure).split())[:200]}). Is "
            "it a local system, or is the file damaged? Warp it: gdalwarp -t_srs EPSG:<code> FILE OUT."
        ) from None


def _check_place(path: str | Path, source: Any) -> None:
    """Refuse a picture that does not know where it is."""
    if source.crs is None:
        raise InputError(
            f"{path}: names no coordinate system; expected a GeoTIFF with one. If it is known, write it in: "
            "gdal_edit.py -a_srs EPSG:<code> FILE."
        )
    if source.transform.is_identity:
        raise InputError(
            f"{path}: has pixels but no place (no georeference); expected a GeoTIFF. Does its world file (.tfw) lie "
            "beside it?"
        )


def _box(source: Any) -> Bounds:
    """Box around the file's four corners, in its own CRS; also where it is rotated."""
    place, column, row = source.transform, (0, source.width) * 2, (0, 0, source.height, source.height)
    x = [place.a * u + place.b * v + place.c for u, v in zip(column, row, strict=True)]
    y = [place.d * u + place.e * v + place.f for u, v in zip(column, row, strict=True)]
    return min(x), min(y), max(x), max(y)


def _overlap(path: str | Path, wanted: Bounds, covered: Bounds) -> Bounds:
    west, south = max(wanted[0], covered[0]), max(wanted[1], covered[1])
    east, north = min(wanted[2], covered[2]), min(wanted[3], covered[3])
    if not (west < east and south < north):
        raise InputError(
            f"{path}: covers {_words(covered)}; the map needs {_words(wanted)}: no overlap. Give the orthophoto of "
            "this site, and check the config's crs and the order of E and N in the survey."
        )
    return west, south, east, north


def _words(box: Bounds) -> str:
    return f"E {box[0]:.0f} … {box[2]:.0f}, N {box[1]:.0f} … {box[3]:.0f}"


def _size(path: str | Path, source: Any, target: Any, box: Bounds, wanted: Bounds, most_px: int) -> tuple[int, int]:
    """Width and height in square pixels: not finer than the file, nor `most_px` on the longer side of the map."""
    finest_m = _pixel_m(source, target, box)
    if not math.isfinite(finest_m):
        raise InputError(f"{path}: its pixels have no size in the map's system. Is its georeference damaged?")
    pixel_m = max(finest_m, max(wanted[2] - wanted[0], wanted[3] - wanted[1]) / most_px)
    return max(1, round((box[2] - box[0]) / pixel_m)), max(1, round((box[3] - box[1]) / pixel_m))


def _pixel_m(source: Any, target: Any, box: Bounds) -> float:
    """The shorter side of the file's pixel in the middle of the box, in the box's CRS."""
    from rasterio.warp import transform

    middle = transform(target, source.crs, [(box[0] + box[2]) / 2.0], [(box[1] + box[3]) / 2.0])
    x, y, place = middle[0][0], middle[1][0], source.transform
    corner = transform(source.crs, target, [x, x + place.a, x + place.b], [y, y + place.d, y + place.e])
    east, north = corner[0], corner[1]
    return min(math.hypot(east[i] - east[0], north[i] - north[0]) for i in (1, 2))


def _colour_bands(source: Any) -> list[int]:
    from rasterio.enums import ColorInterp

    colours = [i for i, kind in zip(source.indexes, source.colorinterp, strict=True) if kind != ColorInterp.alpha]
    return colours[:3] if len(colours) >= 3 else colours[:1]


def _palette(source: Any) -> UInt8[np.ndarray, "n 4"] | None:
    """The colours of a one-band file that holds numbers of colours, by number."""
    from rasterio.enums import ColorInterp

    if source.colorinterp[0] != ColorInterp.palette or source.dtypes[0] not in ("uint8", "uint16"):
        return None
    table = np.zeros((np.iinfo(source.dtypes[0]).max + 1, 4), np.uint8)
    for number, colour in source.colormap(1).items():
        if number < len(table):
            table[number] = colour
    return table


def _bytes(path: str | Path, value: np.ndarray, known: np.ndarray) -> UInt8[np.ndarray, "c h w"]:
    """Colours as bytes: bytes as they are, others stretched."""
    if value.dtype == np.uint8:
        return value
    if not np.issubdtype(value.dtype, np.integer) and not np.issubdtype(value.dtype, np.floating):
        raise InputError(
            f"{path}: holds values of type {value.dtype}; expected colours (8 or 16 bits, or real numbers)."
        )
    shown = value[:, known].astype(float)
    shown = shown[np.isfinite(shown)]
    low, high = np.percentile(shown, [2.0, 98.0]) if shown.size else (0.0, 1.0)
    stretched = (np.nan_to_num(value.astype(float)) - low) / max(high - low, np.finfo(float).tiny)
    return (255.0 * np.clip(stretched, 0.0, 1.0)).round().astype(np.uint8)
