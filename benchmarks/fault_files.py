"""Files that are not what they should be: far too large, a device, a pipe, empty, cut off."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks import fault_inputs as inputs
from benchmarks.fault_case import Case, Change

LARGE_BYTES = 10_000_000_000
RUN_RESULTS = ("trajectory.tum", "anchors.csv", "trajectory.geojson")
QUIET = ("--out", "out", "--quiet")
# Of the small session: the config, one of its files, its kind in words.
_READ_BY_RUN = (
    ("poses", "poses.yaml", "config"),
    ("poses", "icp.tum", "TUM trajectory"),
    ("poses", "sightings.csv", "sightings"),
    ("poses", "survey.csv", "survey"),
    ("corners", "corners.csv", "corners"),
    ("corners", "rig.yaml", "cameras"),
    ("stops", "stops.csv", "control points"),
    ("truth", "icp.kitti", "KITTI trajectory"),
    ("truth", "times.txt", "times of KITTI rows"),
)
# Formats that the small session has no files of: the file is named by --set, and there is nothing to go back to.
_NAMED = (
    (
        "seed=0",
        "trajectories.icp={file: big.g2o, format: g2o, rate_hz: 5, odometry: lidar}",
        "big.g2o",
        "pose graph (g2o)",
    ),
    ("trajectories.icp.file=big.csv", "trajectories.icp.format=euroc", "big.csv", "EuRoC trajectory"),
    ("seed=0", "trajectories.icp={file: big.npy, format: npy, rate_hz: 5, odometry: lidar}", "big.npy", "NumPy poses"),
    ("noise.file=noise.json", "noise.use=fixed", "noise.json", "learned noise"),
    ("basemap=big.tif", "report.interactive=true", "big.tif", "GeoTIFF"),
)
_CLOUDS = (("big.ply", "PLY cloud"), ("big.las", "LAS cloud"), ("big.laz", "LAZ cloud"))
_SCANS = (("big.pcd", "PCD scan"), ("big.bin", "KITTI scan"), ("big.npz", "NumPy scan"), ("big.npy", "NumPy scan"))


def sparse(name: str) -> Change:
    """Puts a file of ten gigabytes, all of them holes, in the place of another."""

    def spoil(place: Path) -> None:
        (place / name).unlink(missing_ok=True)
        (place / name).parent.mkdir(exist_ok=True)
        with (place / name).open("wb") as file:
            file.truncate(LARGE_BYTES)

    return spoil


def device(name: str) -> Change:
    """A link to a device that never ends."""

    def spoil(place: Path) -> None:
        (place / name).unlink(missing_ok=True)
        (place / name).symlink_to("/dev/zero")

    return spoil


def pipe(name: str) -> Change:
    """A named pipe that nobody writes to."""

    def spoil(place: Path) -> None:
        (place / name).unlink(missing_ok=True)
        os.mkfifo(place / name)

    return spoil


def folder(name: str) -> Change:
    def spoil(place: Path) -> None:
        (place / name).unlink(missing_ok=True)
        (place / name).mkdir()

    return spoil


def restored(sound: Change, name: str) -> Change:
    """Takes away what stands in a file's place, and copies the sound inputs there again."""

    def mend(place: Path) -> None:
        path = place / name
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink(missing_ok=True)
        sound(place)

    return mend


_FAULTS: tuple[tuple[str, str, Callable[[str], Change]], ...] = (
    ("10 GB", "is a sparse file of 10 GB", sparse),
    ("device", "is a link to /dev/zero", device),
    ("pipe", "is a named pipe without a writer", pipe),
    ("folder", "is a folder", folder),
)


def file_cases() -> Iterator[Case]:
    """Every kind of file that is read, too large or no file at all."""
    for config, name, words in _READ_BY_RUN:
        for short, done, fault in _FAULTS:
            yield Case(
                f"{short}: {name} ({config})",
                f"the {words} {name} {done}",
                inputs.session(),
                ("run", f"{config}.yaml", *QUIET),
                fault(name),
                restored(inputs.session(), name),
                says=(name,),
                results=RUN_RESULTS,
            )
    for where, more, name, words in _NAMED:
        arguments = ("run", "poses.yaml", "--set", where, "--set", more, *QUIET)
        for short, done, fault in _FAULTS[:3]:
            yield Case(
                f"{short}: {name}", f"the {words} {done}", inputs.session(), arguments, fault(name), says=(name,)
            )
    for name, words in _CLOUDS:
        arguments = ("compare", name, name, "--names", "first,second", *QUIET)
        for short, done, fault in _FAULTS[:3]:
            yield Case(
                f"{short}: {name}", f"the {words} {done}", inputs.session(), arguments, fault(name), says=(name,)
            )
    for name, words in _SCANS:
        arguments = ("odometry", "scans", "--rate", "10", *QUIET)
        for short, done, fault in _FAULTS[:3]:
            path = f"scans/{name}"
            yield Case(f"{short}: {path}", f"the {words} {done}", _with_folder, arguments, fault(path), says=(name,))
    for short, done, fault in _FAULTS:
        yield Case(
            f"{short}: map.db",
            f"the RTAB-Map database {done}",
            inputs.database(),
            ("rtabmap", "map.db", *QUIET),
            fault("map.db"),
            restored(inputs.database(), "map.db"),
            says=("map.db",),
            results=("odometry.tum",),
        )
        yield Case(
            f"{short}: images.bag",
            f"the bag {done}",
            inputs.bag("ros1"),
            ("detect", "images.bag", "--workers", "1", "--family", "aruco_mip_36h12", *QUIET),
            fault("images.bag"),
            restored(inputs.bag("ros1"), "images.bag"),
            says=("images.bag",),
        )


def _with_folder(place: Path) -> None:
    (place / "scans").mkdir()
