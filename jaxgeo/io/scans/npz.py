"""NumPy archives of points: quantised or not, without Python objects."""

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Float, Num

from jaxgeo.errors import ScanError
from jaxgeo.io.regular_file import check_regular

_MOST_UNPACKED, _SMALL_BYTES = 100, 1 << 26
COLUMN_NAMES = ("intensity", "point_times", "time", "t", "timestamp", "offset_time", "time_stamp")


def load_arrays(path: str | Path, error: type[ScanError]) -> dict[str, np.ndarray]:
    """The arrays of an `.npz` by name. Nothing is unpickled.

    Raises:
        error: no such file, not one of NumPy's, damaged, or with Python objects in it.
    """
    check_regular(path, error)
    try:
        with Path(path).open("rb") as file:  # np.load would leave it open where the archive is damaged
            if file.read(2) != b"PK":  # of anything else np.load says that it is pickled
                raise error(f"{path}: cannot be read as NumPy's .npz: is no zip archive. Is it cut off?")
            _check_size(path, file, error)
            file.seek(0)
            loaded = np.load(file, allow_pickle=False)
            arrays = {name: loaded[name] for name in loaded.files}
            for name, array in arrays.items():
                if not isinstance(array, np.ndarray):  # of a member without NumPy's head, its bytes
                    raise error(f"{path}: {name!r} in it is no array of NumPy's. Is it damaged, or another archive?")
            return arrays
    except FileNotFoundError:
        raise error(f"{path}: no such file. Check the path.") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder, expected an .npz file. Name the file in it.") from None
    except error:
        raise
    except Exception as failure:  # of a damaged file: ValueError, BadZipFile, zlib.error, TokenError, MemoryError, …
        if "Object arrays" in str(failure):
            raise error(
                f"{path}: holds Python objects (pickled), which are not read: they could run code. Save plain arrays "
                "of numbers."
            ) from None
        reason = str(failure).splitlines()[0][:120].rstrip(".") if str(failure) else type(failure).__name__
        raise error(f"{path}: cannot be read as NumPy's: {reason}. Is it cut off, or of another format?") from None


def _check_size(path: str | Path, file: IO[bytes], error: type[ScanError]) -> None:
    """Refuse an archive that would unpack to far more than any recording does: points shrink to a half or a tenth."""
    with zipfile.ZipFile(file) as archive:
        full = sum(member.file_size for member in archive.infolist())
    size = Path(path).stat().st_size
    if full > _MOST_UNPACKED * size + _SMALL_BYTES:
        raise error(
            f"{path}: would unpack from {size:,} to {full:,} bytes, which no scans do. Is it damaged, or a trap?"
        )


def points_of_arrays(arrays: Mapping[str, np.ndarray], place: str, error: type[ScanError]) -> Num[np.ndarray, "n 3"]:
    """The array `xyz` (or `points`), as stored, checked together with its `scale` and `offset`.

    Raises:
        error: there is none, its shape is not (n, 3), it holds no numbers, or whole numbers have no scale.
    """
    name = next((name for name in ("xyz", "points") if name in arrays), None)
    if name is None:
        raise error(f"{place}: no array 'xyz' of points. It holds {_listing(arrays)}.")
    xyz = arrays[name]
    if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype.kind not in "iuf":
        raise error(f"{place}: {name!r} is {_shown(xyz)}, expected numbers of shape (n, 3).")
    if xyz.dtype.kind in "iu" and "scale" not in arrays:
        raise error(
            f"{place}: {name!r} holds whole numbers ({xyz.dtype}) and no 'scale' says how many metres one step is. It "
            f"holds {_listing(arrays)}."
        )
    for key in ("scale", "offset"):
        value = arrays.get(key)
        if value is not None and (value.dtype.kind not in "iuf" or value.shape not in ((), (1,), (3,))):
            raise error(f"{place}: {key!r} is {_shown(value)}, expected one number, or three for x, y and z.")
        if value is not None and not (np.isfinite(value).all() and (key == "offset" or (value > 0).all())):
            raise error(f"{place}: {key!r} is {value.tolist()}, expected finite metres, and a scale above 0.")
    return xyz


def columns_of_points(
    xyz: Num[np.ndarray, "n 3"], arrays: Mapping[str, np.ndarray], rows: slice = slice(None)
) -> dict[str, np.ndarray]:
    """Coordinates in metres, times and intensity of some rows of an archive."""
    points_m = _metres(xyz[rows], arrays)
    rest = {name: arrays[name][rows] for name in COLUMN_NAMES if name in arrays}
    return {**dict(zip("xyz", points_m.T, strict=True)), **rest}


def check_columns(arrays: Mapping[str, np.ndarray], n_points: int, place: str, error: type[ScanError]) -> None:
    """Refuse times and intensities that are not one number for each point.

    Raises:
        error: with the shape that was met.
    """
    for name in COLUMN_NAMES:
        values = arrays.get(name)
        if values is not None and (values.shape != (n_points,) or values.dtype.kind not in "iuf"):
            raise error(
                f"{place}: {name!r} is {_shown(values)}, expected one number for each of the {n_points} points."
            )


def _metres(xyz: Num[np.ndarray, "n 3"], arrays: Mapping[str, np.ndarray]) -> Float[np.ndarray, "n 3"]:
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float64: no points, as NaNs are none
        return xyz * arrays.get("scale", np.float64(1.0)).astype(np.float64) + arrays.get("offset", np.float64(0.0))


def _shown(values: np.ndarray) -> str:
    return f"{values.dtype} of shape {values.shape}"


def _listing(arrays: Mapping[str, np.ndarray]) -> str:
    return ", ".join(f"{name} ({_shown(values)})" for name, values in arrays.items()) or "nothing"
