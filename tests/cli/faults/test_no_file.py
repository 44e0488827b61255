"""Where a file is expected: a device that never ends, a pipe that never begins, ten gigabytes, a folder."""

import os
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jaxgeo.config import load_config
from jaxgeo.errors import JaxgeoError
from jaxgeo.io.frames.folder import FolderFrames
from jaxgeo.io.npy_poses import read_npy_poses
from jaxgeo.io.ply import read_ply_header
from jaxgeo.io.rgbd.depth import depth_of_file
from jaxgeo.io.scans.scan_file import read_scan_file
from jaxgeo.io.tum import read_tum


def _large(path: Path) -> None:
    path.touch()
    os.truncate(path, 10_000_000_000)


def _image(path: Path) -> Any:
    return list(FolderFrames(path.parent, rate_hz=1.0))


READERS: dict[str, Callable[[Path], Any]] = {
    "poses.yaml": load_config,
    "icp.tum": read_tum,
    "poses.npy": lambda path: read_npy_poses(path, rate_hz=1.0),
    "cloud.ply": read_ply_header,
    "scan.pcd": read_scan_file,
    "scan.bin": read_scan_file,
    "scan.npz": read_scan_file,
    "scan.npy": read_scan_file,
    "image.png": _image,
    "depth.png": lambda path: depth_of_file(path, 0.001),
}
FAULTS: dict[str, Callable[[Path], None]] = {
    "device": lambda path: path.symlink_to("/dev/zero"),
    "pipe": lambda path: os.mkfifo(path),
    "large": _large,
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", READERS)
def test_it_is_refused_at_once_and_by_name(tmp_path: Path, name: str, fault: str) -> None:
    path = tmp_path / name
    FAULTS[fault](path)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(JaxgeoError, match=name):
        READERS[name](path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 200_000
