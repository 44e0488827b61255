from pathlib import Path

import numpy as np
import pytest
from corrected_files import ORIGIN, write_corrected
from test_carry import wandering

from jaxgeo.data import Trajectory
from jaxgeo.errors import JaxgeoError
from jaxgeo.io import write_tum
from jaxgeo.mapping.carried_after import read_corrected


@pytest.mark.parametrize("file", [".", "trajectory.tum", "trajectory_grid.csv"])
def test_what_a_run_writes(tmp_path: Path, file: str) -> None:
    trajectory = wandering(0)
    write_corrected(tmp_path / "out", trajectory, simulated=True)
    found = read_corrected(tmp_path / "out" / file)
    np.testing.assert_array_equal(found.trajectory.stamp_s, trajectory.stamp_s)
    np.testing.assert_allclose(found.trajectory.position_m, trajectory.position_m, atol=1e-10)
    np.testing.assert_allclose(found.trajectory.quat_wxyz, trajectory.quat_wxyz, atol=1e-14)
    assert found.frame.crs == "EPSG:2169"
    assert found.frame.origin_enh_m.tolist() == ORIGIN.tolist()
    assert found.simulated


def test_one_of_several_by_name(tmp_path: Path) -> None:
    for seed, name in enumerate(("icp", "vio")):
        write_corrected(tmp_path / name, wandering(seed), name)
    found = read_corrected(tmp_path, "vio")
    np.testing.assert_array_equal(found.trajectory.position_m, wandering(1).position_m)
    assert not found.simulated
    with pytest.raises(JaxgeoError, match=r"no trajectory in this folder \(found: icp, vio\)"):
        read_corrected(tmp_path)
    with pytest.raises(JaxgeoError, match=r"no trajectory 'lidar' in this folder \(found: icp, vio\)"):
        read_corrected(tmp_path, "lidar")
    with pytest.raises(JaxgeoError, match="holds the trajectory 'icp', not 'vio'"):
        read_corrected(tmp_path / "icp", "vio")


def test_a_file_without_origin_holds_full_coordinates(tmp_path: Path) -> None:
    local = wandering(0)
    write_tum(tmp_path / "t.tum", Trajectory(local.stamp_s, local.position_m + ORIGIN, local.quat_wxyz))
    found = read_corrected(tmp_path / "t.tum", crs="EPSG:9897")
    assert found.frame.crs == "EPSG:9897"
    np.testing.assert_allclose(found.frame.to_grid(found.trajectory.position_m), local.position_m + ORIGIN, atol=1e-9)
    assert np.abs(found.trajectory.position_m).max() < 200.0
    assert read_corrected(tmp_path / "t.tum").frame.crs == "local"


def test_a_height_system_may_be_added_but_no_other_grid_named(tmp_path: Path) -> None:
    write_corrected(tmp_path, wandering(0))
    found = read_corrected(tmp_path, crs="EPSG:2169+5774")
    assert found.frame.height == "NG95 height"
    assert found.frame.origin_enh_m.tolist() == ORIGIN.tolist()
    for other in ("EPSG:32632", "local"):
        with pytest.raises(JaxgeoError, match=rf"is in EPSG:2169, but --crs says {other}"):
            read_corrected(tmp_path, crs=other)


def test_a_spoilt_origin_is_refused(tmp_path: Path) -> None:
    write_corrected(tmp_path, wandering(0))
    file = tmp_path / "trajectory.tum"
    file.write_text(file.read_text().replace("N=76800.0", "N=?"))
    with pytest.raises(JaxgeoError, match=r"its comments say `origin E=79300\.0 N=\? h=300\.0 m`"):
        read_corrected(file)
