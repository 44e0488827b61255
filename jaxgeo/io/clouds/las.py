"""Point clouds read from LAS and LAZ, every version that laspy reads. laspy lives here."""

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxgeo.errors import CloudError, InputError
from jaxgeo.io.clouds.chunk import CloudChunk, warn_left_out
from jaxgeo.io.clouds.las_head import las_problem
from jaxgeo.io.clouds.laszip_head import laszip_problem
from jaxgeo.io.clouds.source import CHUNK, CloudSource
from jaxgeo.io.regular_file import check_regular

_SHARED = {"gps_time": "stamp_s", "scan_angle_rank": "scan_angle"}
_RANK_STEP = 0.006  # degrees in a step of `scan_angle` (point formats 6 and above); `scan_angle_rank` is in degrees
FLOAT = "_float"  # behind the name of a standard dimension: a float column that could not be put into it
_WAVE = ("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location", "x_t", "y_t", "z_t")
_UNDECODABLE = (RuntimeError, ValueError, OSError, EOFError, struct.error, ArithmeticError, LookupError, MemoryError)


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
            left_out = [name for name, d in kinds.items() if not name or name in _WAVE or d.num_elements != 1]
            warn_left_out(path, left_out, "waveforms and lists of numbers are not carried on")
            shared = {_SHARED.get(name, name): name for name in kinds if name not in left_out}
            # A float intensity that PLY brought here: it stands for the rounded one of the standard.
            self._dimension = {name: shared.get(name + FLOAT, own) for name, own in shared.items()}
            for name in list(self._dimension):
                if name.endswith(FLOAT) and name.removesuffix(FLOAT) in shared:
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
        check_regular(self.path, CloudError)
        laspy = laspy_library()
        with contextlib.ExitStack() as stack:
            with self._decoding("at its head"):
                try:
                    if problem := las_problem(self.path):
                        raise ValueError(problem)
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
