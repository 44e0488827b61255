"""A point cloud in a file, whatever its format, read piece by piece."""

import abc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import CloudError
from jaxgeo.io.clouds.chunk import CloudChunk, Columns

CHUNK = 1_000_000
SUFFIXES = (".las", ".laz", ".ply")


class CloudSource(abc.ABC):
    """What is in a cloud's file. Its points come from `chunks`, as often as asked.

    Attributes:
        path: the file.
        n_points: of the whole cloud.
        columns: names and types of what each point carries beside x, y, z.
        crs: as the file says: `EPSG:<code>` or WKT; None where it says nothing.
        origin_enh_m: (3,) to be added to `points_m` for coordinates of `crs`; zero where points are written in full.
        standard_gps_time: stamps are marked as GPS seconds less 1e9 (of LAS); they are passed on as they are.
    """

    path: str | Path
    n_points: int
    columns: Columns
    crs: str | None
    origin_enh_m: Float[np.ndarray, "3"]
    standard_gps_time: bool = False

    @abc.abstractmethod
    def chunks(self, size: int = CHUNK) -> Iterator[CloudChunk]:
        """The points in order, at most `size` at once.

        Raises:
            CloudError: the file ends early or cannot be decoded.
        """

    @abc.abstractmethod
    def column(self, name: str, size: int = CHUNK) -> Iterator[np.ndarray]:
        """One column alone, which may be quicker than `chunks`; raises as they do."""


def open_cloud(path: str | Path) -> CloudSource:
    """Open a LAS, LAZ or PLY cloud; the suffix says which.

    Raises:
        CloudError: no such file, another suffix, a malformed header, no points.
        InputError: LAS, and laspy is not installed.
    """
    match Path(path).suffix.lower():
        case ".ply":
            from jaxgeo.io.clouds.ply_cloud import PlyCloud

            source = PlyCloud(path)
        case ".las" | ".laz":
            from jaxgeo.io.clouds.las import LasCloud

            source = LasCloud(path)
        case other:
            raise CloudError(f"{path}: suffix {other!r}; expected a point cloud: {', '.join(SUFFIXES)}. Convert it.")
    if source.n_points == 0:
        raise CloudError(f"{path}: holds no points. Was writing it cut off?")
    return source
