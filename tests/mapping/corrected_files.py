"""The files that a run writes of a corrected trajectory, without running one."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from jaxgeo.data import Trajectory
from jaxgeo.export.trajectory_files import grid_text, tum_text
from jaxgeo.georef import LocalFrame

ORIGIN = np.array([79_300.0, 76_800.0, 300.0])


def write_corrected(
    folder: Path, trajectory: Trajectory, name: str = "icp", crs: str = "EPSG:2169", simulated: bool = False
) -> Path:
    """`trajectory` is in the local frame."""
    covariance = np.tile(1e-4 * np.eye(6), (len(trajectory), 1, 1))
    result: Any = SimpleNamespace(
        name="a session",
        simulated=simulated,
        frame=LocalFrame.create(crs, ORIGIN),
        trajectories={name: SimpleNamespace(corrected=trajectory, covariance=covariance)},
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trajectory.tum").write_text(tum_text(result, name))
    (folder / "trajectory_grid.csv").write_text(grid_text(result, name))
    return folder
