"""Where a cloud is written to, whatever the format."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import CloudError
from jaxgeo.io.clouds.chunk import CloudChunk, Columns
from jaxgeo.io.clouds.source import SUFFIXES


class CloudWriter(Protocol):
    """Takes a cloud piece by piece; the file appears when the block ends well. Use as a context manager."""

    def __enter__(self) -> Self: ...

    def append(self, chunk: CloudChunk) -> None:
        """Write points: easting, northing, height less the origin; the columns are those the writer was opened with."""
        ...

    def __exit__(self, *failure: Any) -> None: ...


def cloud_writer(
    path: str | Path,
    columns: Columns,
    origin_enh_m: Float[np.ndarray, "3"],
    crs: str | None,
    *,
    standard_gps_time: bool = False,
    comments: Sequence[str] = (),
) -> CloudWriter:
    """A writer for LAS, LAZ or PLY; the suffix says which.

    Args:
        columns: names and types, as in `CloudSource`.
        origin_enh_m: of the points to come. LAS is written in full coordinates, PLY about it.
        crs: `EPSG:<code>[+<code>]`; None: a site frame without a datum.
        standard_gps_time: LAS: mark the stamps as GPS seconds less 1e9.
        comments: lines for the head of the file (LAS: its text area description).

    Raises:
        CloudError: another suffix.
        InputError: LAS, and laspy is not installed.

    Warns:
        InputWarning: of columns that the format cannot hold; they are left out.
    """
    match Path(path).suffix.lower():
        case ".ply":
            from jaxgeo.io.clouds.ply_cloud import PlyCloudWriter

            return PlyCloudWriter(path, columns, origin_enh_m, crs or "local", comments)
        case ".las" | ".laz":
            from jaxgeo.io.clouds.las_writer import LasCloudWriter

            return LasCloudWriter(path, columns, origin_enh_m, crs, standard_gps_time, comments)
        case other:
            raise CloudError(f"{path}: suffix {other!r}; a cloud is written as {', '.join(SUFFIXES)}.")
