"""Point clouds written as LAS 1.4 (ASPRS, R15): point format 7 with colours, else 6; the CRS as WKT.

Coordinates are whole millimetres about an offset of whole metres.
"""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from jaxgeo import __version__
from jaxgeo.errors import CloudError
from jaxgeo.io.atomic import atomic_path
from jaxgeo.io.clouds.chunk import COLOUR, CloudChunk, Columns, warn_left_out
from jaxgeo.io.clouds.las import FLOAT, laspy_library
from jaxgeo.io.clouds.wkt import las_wkt

SCALE_M = 1e-3
_OWN = {"stamp_s": "gps_time"}
_NAME_BYTES = 32
_TEXT_AREA = ("LASF_Spec", 3)


class LasCloudWriter:
    """Writes a cloud as LAS 1.4, or LAZ by the suffix. Use as a context manager."""

    def __init__(
        self,
        path: str | Path,
        columns: Columns,
        origin_enh_m: Float[np.ndarray, "3"],
        crs: str | None,
        standard_gps_time: bool = False,
        comments: Sequence[str] = (),
    ) -> None:
        """`crs`: None writes no CRS (a site frame). `comments` become the file's text area description.

        Raises:
            InputError: laspy is not installed.

        Warns:
            InputWarning: of columns that LAS cannot hold; they are left out.
        """
        laspy = laspy_library()
        colour = all(name in columns for name in COLOUR)
        header = laspy.LasHeader(version="1.4", point_format=7 if colour else 6)
        self._path = path
        # The offset is whole, so that coordinates in the file are whole millimetres of the grid.
        offset_m = np.round(np.asarray(origin_enh_m, dtype=np.float64))
        self._shift_m = np.asarray(origin_enh_m, dtype=np.float64) - offset_m
        header.offsets, header.scales = offset_m, np.full(3, SCALE_M)
        header.generating_software = f"jaxgeo {__version__}"
        header.system_identifier = "jaxgeo"
        if standard_gps_time:
            header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
        header.global_encoding.wkt = True
        if crs is not None:
            header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(las_wkt(crs)))
        if comments:
            text = "\n".join(comments).encode() + b"\0"
            header.vlrs.append(laspy.VLR(*_TEXT_AREA, description="text area description", record_data=text))
        standard = {d.name: d for d in header.point_format.dimensions}
        self._places, extra = _places(path, columns, standard)
        self._limits = {name: _limits(standard[own]) for name, own in self._places.items() if own in standard}
        header.add_extra_dims([laspy.ExtraBytesParams(name=name, type=kind) for name, kind in extra.items()])
        self._header = header
        self.count = 0

    def __enter__(self) -> Self:
        laspy = laspy_library()
        with contextlib.ExitStack() as stack, self._writing():
            temporary = stack.enter_context(atomic_path(self._path))
            file = stack.enter_context(temporary.open("w+b"))
            compressed = Path(self._path).suffix.lower() == ".laz"
            self._writer = laspy.LasWriter(file, self._header, do_compress=compressed, closefd=False)
            self._stack = stack.pop_all()
        return self

    def append(self, chunk: CloudChunk) -> None:
        """Write points; raises CloudError where one lies too far off, or a column does not fit its dimension."""
        laspy = laspy_library()
        record = laspy.ScaleAwarePointRecord.zeros(len(chunk), header=self._header)
        steps = np.round((chunk.points_m + self._shift_m) / SCALE_M)
        wrong = ~(np.abs(steps) <= np.iinfo(np.int32).max).all(axis=1)
        if wrong.any():
            place = chunk.points_m[int(np.argmax(wrong))]
            raise CloudError(
                f"{self._path}: point {place.tolist()} m from the origin; LAS holds 2147 km about it in millimetres. "
                "Are the coordinates metres, and is the trajectory the cloud's own?"
            )
        record["X"], record["Y"], record["Z"] = steps.astype(np.int32).T
        for name in ("return_number", "number_of_returns"):
            record[name] = np.ones(len(chunk), np.uint8)
        for name, own in self._places.items():
            record[own] = self._checked(name, chunk.columns[name])
        if self._places.get("intensity") == "intensity" + FLOAT:
            rounded = np.nan_to_num(np.round(chunk.columns["intensity"].astype(np.float64)))
            record["intensity"] = np.clip(rounded, 0, 65535).astype(np.uint16)
        with self._writing():
            self._writer.write_points(record)
        self.count += len(chunk)

    def _checked(self, name: str, values: np.ndarray) -> np.ndarray:
        if name not in self._limits or not len(values):
            return values
        low, high = self._limits[name]
        wrong = (values < low) | (values > high)
        if wrong.any():
            raise CloudError(
                f"{self._path}: column {name!r} holds {values[int(np.argmax(wrong))]}; its LAS dimension holds {low} "
                f"to {high}. Rename the column to keep it as extra bytes."
            )
        return values

    def __exit__(self, *failure: Any) -> None:
        if failure[0] is not None:  # the file is thrown away; finishing it could only hide what went wrong
            self._stack.__exit__(*failure)
            return
        with self._stack, self._writing():
            self._writer.close()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        laspy = laspy_library()
        try:
            yield
        except (laspy.errors.LaspyException, RuntimeError, OSError) as failure:
            raise CloudError(
                f"{self._path}: cannot be written: {' '.join(str(failure).split())[:200]}. Is there room on the disk?"
            ) from None


def _places(path: str | Path, columns: Columns, standard: dict[str, Any]) -> tuple[dict[str, str], dict[str, np.dtype]]:
    """The LAS dimension of every column, and the extra bytes that are to be added."""
    places: dict[str, str] = {}
    extra: dict[str, np.dtype] = {}
    left_out = []
    for name, kind in columns.items():
        own = _OWN.get(name, name)
        if own in standard and (kind.kind in "iub" or own == "gps_time"):
            places[name] = own
            continue
        own = own + FLOAT if own in standard else own
        if kind.kind not in "iuf" or kind.itemsize not in (1, 2, 4, 8) or not own.isascii() or len(own) > _NAME_BYTES:
            left_out.append(name)
            continue
        places[name], extra[own] = own, kind
    warn_left_out(path, left_out, f"LAS holds numbers, under names of up to {_NAME_BYTES} ASCII characters")
    return places, extra


def _limits(dimension: Any) -> tuple[float, float]:
    return (-np.inf, np.inf) if dimension.kind.name == "FloatingPoint" else (dimension.min, dimension.max)
