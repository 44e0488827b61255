"""Point clouds as PLY: x, y, z about an origin that the header's comments name."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import CloudError
from jaxgeo.io.clouds.chunk import COLOUR, NORMAL, CloudChunk, Columns, warn_left_out
from jaxgeo.io.clouds.source import CHUNK, CloudSource
from jaxgeo.io.ply import PlyWriter, ply_vertices, read_ply_header

_XYZ = ("x", "y", "z")
# CloudCompare puts `scalar_` before its own columns.
_PREFIX = "scalar_"
_ALIASES = {
    **dict.fromkeys(("stamp_s", "stamp", "time", "timestamp", "gps_time", "gpstime"), "stamp_s"),
    **dict.fromkeys(("intensity", "reflectance", "reflectivity"), "intensity"),
    **dict.fromkeys(("pose_index", "poseindex"), "pose_index"),
    **{name: name for name in (*_XYZ, *COLOUR, *NORMAL)},
}
_ORIGIN, _CRS = "origin_enh_m", "crs"
_FULL = 65535
_PLY_TYPES = {np.dtype(code) for code in ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")}


class PlyCloud(CloudSource):
    """The vertices of a PLY file; see `CloudSource`."""

    def __init__(self, path: str | Path) -> None:
        """Raises CloudError as `read_ply_header`, and where x, y, z or the origin in the comments are not there."""
        self.path = path
        self._header = read_ply_header(path)
        names = self._header.dtype.names or ()
        self._property = _shared_names(names)
        missing = [axis for axis in _XYZ if axis not in self._property]
        if missing:
            raise CloudError(
                f"{path}: the vertices have no {', '.join(missing)}; they have {', '.join(names)[:400]}. Is it a cloud?"
            )
        self.n_points = self._header.n_vertices
        types = {name: self._header.dtype[own] for name, own in self._property.items() if name not in _XYZ}
        self._full_colour = {name: _full_scale(types[name]) for name in COLOUR if _has_all(types, COLOUR)}
        self.columns = {
            name: np.dtype("u2") if name in self._full_colour else kind.newbyteorder("=")
            for name, kind in types.items()
        }
        self.crs = _comment(self._header.comments, _CRS)
        self.origin_enh_m = _origin_of(path, self._header.comments)

    def chunks(self, size: int = CHUNK) -> Iterator[CloudChunk]:
        for rows in ply_vertices(self.path, self._header, size):
            with np.errstate(invalid="ignore"):  # of signalling NaNs
                points_m = np.column_stack([rows[self._property[axis]].astype(np.float64) for axis in _XYZ])
            yield CloudChunk(points_m, {name: self._values(rows, name) for name in self.columns})

    def column(self, name: str, size: int = CHUNK) -> Iterator[np.ndarray]:
        for rows in ply_vertices(self.path, self._header, size):
            yield self._values(rows, name)

    def _values(self, rows: np.ndarray, name: str) -> np.ndarray:
        values = rows[self._property[name]]
        full = self._full_colour.get(name)
        if full is None:
            with np.errstate(invalid="ignore"):
                return values.astype(self.columns[name])
        with np.errstate(invalid="ignore", over="ignore"):  # of signalling NaNs, and what is beyond any colour
            scaled = np.nan_to_num(values.astype(np.float64)) * (_FULL / full)
        return np.clip(np.round(scaled), 0, _FULL).astype(np.uint16)


class PlyCloudWriter:
    """Writes a cloud as binary PLY, doubles about the origin, colours of 8 bits. Use as a context manager."""

    def __init__(
        self,
        path: str | Path,
        columns: Columns,
        origin_enh_m: Float[np.ndarray, "3"],
        crs: str,
        comments: Sequence[str],
    ) -> None:
        """Raises CloudError where a column's name cannot be that of a property.

        Warns:
            InputWarning: of columns whose type PLY does not know; they are left out.
        """
        self._colour: tuple[str, ...] = COLOUR if _has_all(columns, COLOUR) else ()
        types = {name: _ply_type(name, kind, self._colour) for name, kind in columns.items()}
        kept = {name: kind for name, kind in types.items() if kind in _PLY_TYPES}
        warn_left_out(path, sorted(types.keys() - kept), "PLY has no type for them")
        self._path = path
        self._dtype = np.dtype([*((axis, "<f8") for axis in _XYZ), *kept.items()])
        place = [
            *comments,
            f"{_CRS} {crs}",
            f"{_ORIGIN} {' '.join(repr(float(x)) for x in origin_enh_m)}",
            f"x y z: easting, northing, height in metres, less {_ORIGIN}",
        ]
        self._writer = PlyWriter(path, self._dtype, place)

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def append(self, chunk: CloudChunk) -> None:
        rows = np.empty(len(chunk), self._dtype)
        for axis, values in zip(_XYZ, chunk.points_m.T, strict=True):
            rows[axis] = values
        for name in self._dtype.names[3:]:  # type: ignore[index]
            values = chunk.columns[name]
            if name in self._colour:
                values = np.round(values / 257.0)
            elif name == "pose_index" and len(values) and values.max(initial=0) > np.iinfo(np.int32).max:
                raise CloudError(f"{self._path}: pose_index {values.max()} does not fit into 32 bits. Write LAZ.")
            rows[name] = values
        self._writer.append(rows)

    def __exit__(self, *failure: Any) -> None:
        self._writer.__exit__(*failure)


def _shared_names(names: Sequence[str]) -> dict[str, str]:
    """The file's property behind every column; where two would get one name, the first does."""
    found: dict[str, str] = {}
    for own in names:
        name = _ALIASES.get(own.casefold().removeprefix(_PREFIX), own)
        found[name if name not in found else own] = own
    return found


def _has_all(columns: Columns, names: Sequence[str]) -> bool:
    return all(name in columns for name in names)


def _full_scale(kind: np.dtype) -> float:
    """The value that stands for full brightness."""
    return 1.0 if kind.kind == "f" else float(np.iinfo(kind).max)


def _ply_type(name: str, kind: np.dtype, colour: tuple[str, ...]) -> np.dtype:
    if name in colour:
        return np.dtype("u1")
    return np.dtype("i4") if name == "pose_index" else np.dtype(kind)


def _comment(comments: Sequence[str], key: str) -> str | None:
    """What follows a key word at the start of a comment."""
    found = next((c.split(maxsplit=1) for c in comments if c.split(maxsplit=1)[:1] == [key]), None)
    return found[1].strip() if found and len(found) == 2 else None


def _origin_of(path: str | Path, comments: Sequence[str]) -> Float[np.ndarray, "3"]:
    text = _comment(comments, _ORIGIN)
    if text is None:
        return np.zeros(3)
    try:
        origin = np.array([float(word) for word in text.split()])
    except ValueError:
        origin = np.zeros(0)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise CloudError(f"{path}: comment `{_ORIGIN} {text}`; expected three numbers: easting, northing, height.")
    return origin
