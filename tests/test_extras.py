"""The optional libraries import, each by itself: a missing system library shows here, not in the middle of a job."""

import subprocess
import sys

import pytest

EXTRAS = [
    "kornia",
    "kornia_rs",
    "torch",
    "open3d",
    "laspy",
    "lazrs",
    "kiss_icp",
    "small_gicp",
    "rosbags",
    "rerun",
    "rasterio",
    "distributed",
    "pyarrow",
    "gtsam",
    "evo",
]


@pytest.mark.parametrize("name", EXTRAS)
def test_imports(name):
    done = subprocess.run([sys.executable, "-c", f"import {name}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{name}: install the extras with `make environment`\n{done.stderr}"
