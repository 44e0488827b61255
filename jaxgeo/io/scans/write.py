"""Scans to files: one scan a file, or many packed in one. What is written reads back through `open_scans`."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import Scan
from jaxgeo.errors import ScanError
from jaxgeo.io.atomic import atomic_path
from jaxgeo.io.item_stamps import check_increasing_stamps
from jaxgeo.io.ply import PlyWriter

STEP_M = 0.001


def write_scan(path: str | Path, scan: Scan) -> None:
    """Write one scan; the suffix says the format. The stamp is not written: it belongs into the name or a table.

    `.ply`: binary float32 x, y, z and, where the scan has them, intensity and time (seconds after the stamp). `.npz`:
    the same as arrays `xyz` (int32 steps of 1 mm, so a point moves by up to 0.5 mm an axis), `intensity`, `point_times`
    (float32). `.bin`: KITTI's float32 x, y, z, intensity (0 without).

    Raises:
        ScanError: another suffix; a `.bin`, which has no place for times, of a scan that has them.
        InputError: the folder cannot be written to.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        raise ScanError(f"{path}: suffix {suffix!r}, expected one of {', '.join(_WRITERS)}.")
    _WRITERS[suffix](path, scan)


def write_packed_scans(path: str | Path, scans: Iterable[Scan]) -> None:
    """Write many scans into one `.npz`, which `PackedScans` reads.

    Its arrays: `xyz` (int32 steps of `scale`, 1 mm), `offsets`, `times`, and where the scans have them `intensity` and
    `point_times` (float32). All scans are held in memory until the last has come.

    Raises:
        ScanError: another suffix, no scans, times or intensities of some scans only, or stamps that do not increase.
        InputError: the folder cannot be written to.
    """
    if Path(path).suffix.lower() != ".npz":
        raise ScanError(f"{path}: suffix {Path(path).suffix!r}, expected .npz.")
    parts = [(scan.stamp_s, _arrays(path, scan)) for scan in scans]
    if not parts:
        raise ScanError(f"{path}: no scans to write, expected at least one.")
    stamp_s = np.array([stamp for stamp, _ in parts])
    check_increasing_stamps(stamp_s, lambda row: f"{path}:{row}")
    names = parts[0][1].keys()
    for row, (_, arrays) in enumerate(parts):
        if arrays.keys() != names:
            raise ScanError(
                f"{path}:{row}: the scan has {', '.join(arrays)}, expected {', '.join(names)} as of the first. Leave "
                "out times and intensities that only some scans have."
            )
    bounds = np.cumsum([0, *(len(arrays["xyz"]) for _, arrays in parts)])
    columns = {name: np.concatenate([arrays[name] for _, arrays in parts]) for name in names}
    _save(path, {**columns, "scale": np.float64(STEP_M), "offsets": bounds, "times": stamp_s})


def _write_ply(path: str | Path, scan: Scan) -> None:
    named = {**dict(zip("xyz", scan.points_m.T, strict=True)), "intensity": scan.intensity, "time": scan.time_s}
    columns = {name: values for name, values in named.items() if values is not None}
    rows = np.empty(len(scan), [(name, "<f4") for name in columns])
    for name, values in columns.items():
        rows[name] = values
    with PlyWriter(path, rows.dtype) as writer:
        writer.append(rows)


def _write_kitti(path: str | Path, scan: Scan) -> None:
    if scan.time_s is not None:
        raise ScanError(
            f"{path}: KITTI's .bin has no place for the times of the points of {scan.source}. Write .ply or .npz, or "
            "leave the times out."
        )
    intensity = np.zeros(len(scan)) if scan.intensity is None else scan.intensity
    rows = np.column_stack([scan.points_m, intensity]).astype("<f4")
    with atomic_path(path) as temporary:
        temporary.write_bytes(rows.tobytes())


def _write_npz(path: str | Path, scan: Scan) -> None:
    _save(path, {**_arrays(path, scan), "scale": np.float64(STEP_M)})


def _arrays(path: str | Path, scan: Scan) -> dict[str, np.ndarray]:
    """What of a scan goes into an archive, quantised."""
    found: dict[str, np.ndarray] = {"xyz": _steps(path, scan.source, scan.points_m)}
    if scan.intensity is not None:
        found["intensity"] = scan.intensity.astype(np.float32)
    if scan.time_s is not None:
        found["point_times"] = scan.time_s.astype(np.float32)
    return found


def _steps(path: str | Path, source: str, points_m: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n 3"]:
    steps = np.rint(points_m / STEP_M)
    if not (np.abs(steps) <= np.iinfo(np.int32).max).all():
        raise ScanError(f"{path}: {source} has a coordinate that is not finite or beyond 2147 km, expected metres.")
    return steps.astype(np.int32)


def _save(path: str | Path, arrays: dict[str, np.ndarray | np.float64]) -> None:
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


_WRITERS: dict[str, Callable[[str | Path, Scan], None]] = {
    ".ply": _write_ply,
    ".npz": _write_npz,
    ".bin": _write_kitti,
}
