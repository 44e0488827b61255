"""Files of one scan each: PLY, PCD, KITTI's `.bin`, NumPy's `.npz` and `.npy`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxgeo.io.ply import ply_vertices, read_ply_header
from jaxgeo.io.regular_file import MOST_BYTES, check_regular
from jaxgeo.io.scans.npz import check_columns, columns_of_points, load_arrays, points_of_arrays
from jaxgeo.io.scans.pcd import read_pcd
from jaxgeo.io.scans.scan_source import UnreadableScanError


def read_scan_file(path: Path) -> dict[str, np.ndarray]:
    """The columns of the points, by name and of the types of the file; the suffix says the format.

    `.bin` is KITTI's: float32 x, y, z, intensity a point. `.npz` holds `xyz` (or `points`), for whole numbers with
    `scale` and, if need be, `offset`, and if there `intensity` and `point_times`. `.npy` holds (n, 3), (n, 4) with
    intensities, or a structured array.

    Raises:
        UnreadableScanError: the file is missing, damaged, or of another format than its suffix says.
    """
    check_regular(path, UnreadableScanError, MOST_BYTES)
    try:
        return _READERS[path.suffix.lower()](path)
    except FileNotFoundError:
        raise UnreadableScanError(f"{path}: no such file. Was it moved or not copied?") from None
    except OSError as failure:
        raise UnreadableScanError(f"{path}: cannot be read: {failure.strerror}.") from None


def _of_ply(path: Path) -> dict[str, np.ndarray]:
    header = read_ply_header(path, UnreadableScanError)
    parts = list(ply_vertices(path, header))
    rows = np.concatenate(parts) if parts else np.empty(0, header.dtype)
    return {name: rows[name] for name in header.dtype.names or ()}


def _of_pcd(path: Path) -> dict[str, np.ndarray]:
    return read_pcd(path, path.read_bytes())


def _of_kitti(path: Path) -> dict[str, np.ndarray]:
    data = path.read_bytes()
    if len(data) % 16 or path.name.lower().endswith(".pcd.bin"):  # the latter: nuScenes, with five columns
        raise UnreadableScanError(
            f"{path}: {len(data)} bytes, expected KITTI's rows of float32 x, y, z, intensity, 16 bytes each. Is it cut "
            "off, or has it other columns? Save it as .npz, .ply or .pcd."
        )
    rows = np.frombuffer(data, "<f4").reshape(-1, 4)
    return dict(zip(("x", "y", "z", "intensity"), rows.T, strict=True))


def _of_npz(path: Path) -> dict[str, np.ndarray]:
    arrays = load_arrays(path, UnreadableScanError)
    if "offsets" in arrays:
        raise UnreadableScanError(
            f"{path}: is a packed file of many scans ('offsets'), expected one scan a file. Name it as the "
            "source itself."
        )
    xyz = points_of_arrays(arrays, str(path), UnreadableScanError)
    check_columns(arrays, len(xyz), str(path), UnreadableScanError)
    return columns_of_points(xyz, arrays)


def _of_npy(path: Path) -> dict[str, np.ndarray]:
    try:
        with path.open("rb") as file:
            rows = np.load(file, allow_pickle=False)
    except OSError:
        raise
    except Exception as failure:  # of a damaged file: ValueError, EOFError, TokenError, MemoryError, …
        raise UnreadableScanError(f"{path}: cannot be read as an array: {failure}. Is it cut off?") from None
    if not isinstance(rows, np.ndarray):
        raise UnreadableScanError(f"{path}: is an archive of arrays, expected one array. Rename it to .npz.")
    if rows.dtype.names and rows.ndim == 1:
        return {name: rows[name] for name in rows.dtype.names if rows.dtype[name].kind in "iuf"}
    if rows.ndim != 2 or rows.shape[1] not in (3, 4) or rows.dtype.kind != "f":
        raise UnreadableScanError(
            f"{path}: {rows.dtype} of shape {rows.shape}, expected metres as floats of shape (n, 3), (n, 4) with "
            "intensities, or a structured array with fields x, y, z."
        )
    return dict(zip(("x", "y", "z", "intensity"), rows.T, strict=False))


_READERS: dict[str, Callable[[Path], dict[str, np.ndarray]]] = {
    ".ply": _of_ply,
    ".pcd": _of_pcd,
    ".bin": _of_kitti,
    ".npz": _of_npz,
    ".npy": _of_npy,
}
SCAN_SUFFIXES = tuple(_READERS)
