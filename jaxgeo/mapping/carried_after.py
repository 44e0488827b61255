"""The trajectory that a cloud is to be carried to: what a run wrote, or any corrected trajectory, and its grid."""

import dataclasses
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.errors import SurveyError, TrajectoryError
from jaxgeo.georef import LOCAL, LocalFrame, default_origin, read_crs
from jaxgeo.io.checks import validated_trajectory
from jaxgeo.io.text_file import read_lines
from jaxgeo.io.text_table import float_columns, read_table
from jaxgeo.io.tum import read_tum

LOCAL_FILE = "trajectory.tum"
_GRID_COLUMNS = ("stamp_s", "E_m", "N_m", "h_m", "qw", "qx", "qy", "qz")
_NAME = re.compile(r"corrected trajectory '(.*)': body poses")
_CRS = re.compile(r"crs: (\S+) \(")
_ORIGIN = re.compile(r"origin E=(\S+) N=(\S+) h=(\S+) m")
_SIMULATED = "SIMULATED DATA"


@dataclasses.dataclass(frozen=True)
class CorrectedTrajectory:
    """Where a trajectory really went.

    Attributes:
        trajectory: in the local frame.
        frame: its grid and origin.
        simulated: its file says so.
        file: that was read.
    """

    trajectory: Trajectory
    frame: LocalFrame
    simulated: bool
    file: Path


@dataclasses.dataclass(frozen=True)
class _Heading:
    """What the comments above the rows say; None where they do not."""

    name: str | None
    crs: str | None
    origin_enh_m: Float[np.ndarray, "3"] | None
    simulated: bool


def read_corrected(path: str | Path, name: str | None = None, crs: str | None = None) -> CorrectedTrajectory:
    """Read a corrected trajectory with its grid.

    Args:
        path: the folder of a run, its `trajectory.tum` or `trajectory_grid.csv`, or any TUM file. A TUM file that names
            no origin in its comments holds full coordinates: easting, northing, height.
        name: of the trajectory, where the run has several.
        crs: `EPSG:<code>[+<code>]`: needed where the file names none and the grid is to be known; else it may add a
            height system to the file's.

    Raises:
        TrajectoryError: nothing of the kind in the folder, several and no name, or what the readers refuse.
        SurveyError: `crs` contradicts the file, or cannot carry the coordinates.
    """
    path = Path(path)
    file = _in_folder(path, name) if path.is_dir() else path
    heading = _heading(file)
    if name is not None and heading.name not in (None, name):
        raise TrajectoryError(f"{file}: holds the trajectory {heading.name!r}, not {name!r}. Leave --trajectory out?")
    chosen = _chosen_crs(file, heading.crs, crs)
    in_grid = file.suffix.lower() == ".csv"
    trajectory = _read_grid(file) if in_grid else read_tum(file)
    origin = heading.origin_enh_m
    if origin is None:
        in_grid, origin = True, default_origin(trajectory.position_m)
    try:
        frame = LocalFrame.create(chosen, origin)
    except SurveyError as failure:
        raise SurveyError(f"{file}: {failure}") from None
    if in_grid:
        position_m = frame.to_local(trajectory.position_m)
        trajectory = Trajectory(trajectory.stamp_s, position_m, trajectory.quat_wxyz)
    return CorrectedTrajectory(trajectory, frame, heading.simulated, file)


def _in_folder(folder: Path, name: str | None) -> Path:
    if (folder / LOCAL_FILE).is_file():
        return folder / LOCAL_FILE
    there = sorted(path.parent.name for path in folder.glob(f"*/{LOCAL_FILE}"))
    if name is None and len(there) == 1:
        name = there[0]
    if name not in there:
        found = ", ".join(there) or "none"
        what = "no trajectory" if name is None else f"no trajectory {name!r}"
        raise TrajectoryError(
            f"{folder}: {what} in this folder (found: {found}); expected what `jaxgeo run` writes. Name one of them "
            "with --trajectory, or the file itself."
        )
    return folder / str(name) / LOCAL_FILE


def _heading(file: Path) -> _Heading:
    lines = read_lines(file, TrajectoryError)
    comments = "\n".join(line for line in lines[:50] if line.startswith("#"))
    name, crs, origin = (pattern.search(comments) for pattern in (_NAME, _CRS, _ORIGIN))
    try:
        origin_enh_m = None if origin is None else np.array([float(word) for word in origin.groups()])
    except ValueError:
        raise TrajectoryError(
            f"{file}: its comments say `{origin and origin.group()}`; expected three numbers. Mend that line."
        ) from None
    return _Heading(name and name.group(1), crs and crs.group(1), origin_enh_m, _SIMULATED in comments)


def _chosen_crs(file: Path, said: str | None, given: str | None) -> str:
    if given is None or given == said:
        return said or LOCAL
    if said is not None and (
        said == LOCAL or given == LOCAL or read_crs(said).horizontal != read_crs(given).horizontal
    ):
        raise SurveyError(
            f"{file}: is in {said}, but --crs says {given}. Coordinates are not converted here: leave --crs out, or "
            "name the same grid with a height system."
        )
    return given


def _read_grid(file: Path) -> Trajectory:
    table = read_table(file, error=TrajectoryError)
    values = float_columns(table, _GRID_COLUMNS)
    return validated_trajectory(file, table.line, values[:, 0], values[:, 1:4], values[:, 4:])
