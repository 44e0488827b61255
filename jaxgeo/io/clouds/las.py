"""Point clouds as LAS and LAZ. laspy lives here.

Written is LAS 1.4 (ASPRS, R15): point format 7 with colours, else 6; the CRS as WKT; millimetres about an offset of
whole metres. Read is every version that laspy reads.
"""

import contextlib
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from jaxgeo import __version__
from jaxgeo.errors import CloudError, InputError
from jaxgeo.io.atomic import atomic_path
from jaxgeo.io.clouds.chunk import COLOUR, CloudChunk, Columns, warn_left_out
from jaxgeo.io.clouds.laszip_head import laszip_problem
from jaxgeo.io.clouds.source import CHUNK, CloudSource
from jaxgeo.io.clouds.wkt import las_wkt

SCALE_M = 1e-3
_SHARED = {"gps_time": "stamp_s", "scan_angle_rank": "scan_angle"}
_OWN = {"stamp_s": "gps_time"}
_RANK_STEP = 0.006  # degrees in a step of `scan_angle` (point formats 6 and above); `scan_angle_rank` is in degrees
_FLOAT = "_float"
_NAME_BYTES = 32
_TEXT_AREA = ("LASF_Spec", 3)
_WAVE = ("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location", "x_t", "y_t", "z_t")
_UNDECODABLE = (RuntimeError, ValueError, OSError, EOFError, struct.error, OverflowError, MemoryError)


class LasCloud(CloudSource):
    """The points of a LAS or LAZ file; see `CloudSource`."""

    def __init__(self, path: str | Path) -> None:
        """Raises CloudError for what is no LAS file, or ends before its points do.

        Warns:
            InputWarning: of columns that are left out: waveforms, and those with several numbers a point.
        """
        self.path = path
        with self._reader() as reader:
            header = reader.header
            with self._decoding("at its table of chunks"):
                _check_header(path, header)
            kinds: dict[str, Any] = {d.name: d for d in header.point_format.dimensions if d.name not in ("X", "Y", "Z")}
            left_out = [name for name, d in kinds.items() if name in _WAVE or d.num_elements != 1]
            warn_left_out(path, left_out, "waveforms and lists of numbers are not carried on")
            shared = {_SHARED.get(name, name): name for name in kinds if name not in left_out}
            # A float intensity that PLY brought here: it stands for the rounded one of the standard.
            self._dimension = {name: shared.get(name + _FLOAT, own) for name, own in shared.items()}
            for name in list(self._dimension):
                if name.endswith(_FLOAT) and name.removesuffix(_FLOAT) in shared:
                    del self._dimension[name]
            self.columns = {name: _type_of(name, kinds[own]) for name, own in self._dimension.items()}
            self.n_points = int(header.point_count)
            self.crs = _crs_of(header)
            self.standard_gps_time = header.global_encoding.gps_time_type.value == 1
        self.origin_enh_m = np.zeros(3)

    def chunks(self, size: int = CHUNK) -> Iterator[CloudChunk]:
        for record, header in self._records(size):
            xyz = (record.X, record.Y, record.Z)
            axes = [np.asarray(x) * s + o for x, s, o in zip(xyz, header.scales, header.offsets, strict=True)]
            yield CloudChunk(np.column_stack(axes), {name: self._values(record, name) for name in self.columns})

    def column(self, name: str, size: int = CHUNK) -> Iterator[np.ndarray]:
        laspy = laspy_library()
        only = laspy.DecompressionSelection.base()
        only |= getattr(laspy.DecompressionSelection, self._dimension[name].upper(), laspy.DecompressionSelection.all())
        for record, _ in self._records(size, decompression_selection=only):
            yield self._values(record, name)

    def _values(self, record: Any, name: str) -> np.ndarray:
        values = np.asarray(record[self._dimension[name]])
        if self._dimension[name] == "scan_angle_rank":
            values = np.round(values / _RANK_STEP)
        return values.astype(self.columns[name])

    def _records(self, size: int, **options: Any) -> Iterator[tuple[Any, Any]]:
        done = 0
        with self._reader(**options) as reader:
            while done < self.n_points:
                with self._decoding(f"after {done} of {self.n_points} points"):
                    record = reader.read_points(size)
                    done += len(record)
                    if not len(record):
                        raise ValueError("it ends here")
                yield record, reader.header

    @contextlib.contextmanager
    def _reader(self, **options: Any) -> Iterator[Any]:
        laspy = laspy_library()
        with contextlib.ExitStack() as stack:
            with self._decoding("at its head"):
                try:
                    reader = stack.enter_context(laspy.open(self.path, **options))
                except FileNotFoundError:
                    raise CloudError(f"{self.path}: no such file. Check the path.") from None
            yield reader

    @contextlib.contextmanager
    def _decoding(self, where: str) -> Iterator[None]:
        laspy = laspy_library()
        try:
            yield
        except BaseException as failure:
            # A panic of lazrs is no Exception.
            known = (laspy.errors.LaspyException, *_UNDECODABLE)
            if not isinstance(failure, known) and type(failure).__name__ != "PanicException":
                raise
            raise CloudError(
                f"{self.path}: not readable as LAS {where}: {' '.join(str(failure).split())[:200]}. Was copying or "
                "writing it cut off, or is it of another format?"
            ) from None


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
        with contextlib.ExitStack() as stack:
            temporary = stack.enter_context(atomic_path(self._path))
            compressed = Path(self._path).suffix.lower() == ".laz"
            self._writer = stack.enter_context(
                laspy.open(temporary, mode="w", header=self._header, do_compress=compressed)
            )
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
        if self._places.get("intensity") == "intensity" + _FLOAT:
            rounded = np.nan_to_num(np.round(chunk.columns["intensity"].astype(np.float64)))
            record["intensity"] = np.clip(rounded, 0, 65535).astype(np.uint16)
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
        self._stack.__exit__(*failure)


def laspy_library() -> Any:
    """laspy, or a refusal that says how to install it."""
    try:
        import laspy
        import lazrs  # noqa: F401  (without it laspy reads and writes no LAZ)
    except ImportError as failure:
        raise InputError(
            f"LAS and LAZ clouds need laspy with lazrs, which cannot be imported ({failure}): pip install "
            "'jaxgeo[cloud]'."
        ) from None
    return laspy


def _check_header(path: str | Path, header: Any) -> None:
    numbers = np.array([*header.scales, *header.offsets])
    if not np.isfinite(numbers).all() or (np.asarray(header.scales) == 0).any():
        raise CloudError(
            f"{path}: scales {list(header.scales)}, offsets {list(header.offsets)} in the header; expected finite "
            "numbers, scales not zero. Is the file damaged?"
        )
    if header.are_points_compressed:
        if problem := laszip_problem(path, header):
            raise CloudError(f"{path}: not readable as LAZ: {problem}. Was copying or writing it cut off?")
        return
    size = Path(path).stat().st_size
    there = max(size - header.offset_to_point_data, 0) // header.point_format.size
    if there < header.point_count:
        raise CloudError(
            f"{path}: the header announces {header.point_count} points of {header.point_format.size} bytes, but the "
            f"file ends after {there} of them, at byte {size}. Was copying or writing it cut off?"
        )


def _type_of(name: str, dimension: Any) -> np.dtype:
    if name == "scan_angle":
        return np.dtype(np.int16)
    if dimension.is_scaled:
        return np.dtype(np.float64)
    return np.dtype(np.uint8) if dimension.dtype is None else dimension.dtype.newbyteorder("=")


def _crs_of(header: Any) -> str | None:
    """The WKT as it stands; of older files `EPSG:<code>` from the GeoTIFF keys."""
    known = laspy_library().vlrs.known
    for vlr in [*header.vlrs, *(header.evlrs or [])]:
        if isinstance(vlr, known.WktCoordinateSystemVlr) and vlr.string.strip("\0 "):
            return vlr.string.strip("\0 ")
    for vlr in header.vlrs.get("GeoKeyDirectoryVlr"):
        code = next((key.value_offset for key in vlr.geo_keys if key.id == 3072 and key.tiff_tag_location == 0), None)
        if code is not None and 1024 <= code < 32767:
            return f"EPSG:{code}"
    return None


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
        own = own + _FLOAT if own in standard else own
        if kind.kind not in "iuf" or kind.itemsize not in (1, 2, 4, 8) or not own.isascii() or len(own) > _NAME_BYTES:
            left_out.append(name)
            continue
        places[name], extra[own] = own, kind
    warn_left_out(path, left_out, f"LAS holds numbers, under names of up to {_NAME_BYTES} ASCII characters")
    return places, extra


def _limits(dimension: Any) -> tuple[float, float]:
    return (-np.inf, np.inf) if dimension.kind.name == "FloatingPoint" else (dimension.min, dimension.max)
