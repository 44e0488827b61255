"""The whole way from scans and a drifting odometry to a loop-closed trajectory."""

import dataclasses

import numpy as np
import pytest
from data_root import data_root
from walled_loop import drifting, rmse_m, scans_of, walk, world

from jaxgeo.data import Scan, Trajectory
from jaxgeo.errors import ScanError
from jaxgeo.geometry import rigid
from jaxgeo.mapping.dense_map import DenseMap, build_map
from jaxgeo.mapping.map_settings import MapSettings

MAPPED = MapSettings(threads=1, voxel_m=0.15, keyframe_m=0.8)


@pytest.fixture(scope="module")
def walked() -> tuple[np.ndarray, list[Scan], Trajectory, DenseMap]:
    rng = np.random.default_rng(3)
    truth = walk()
    scans = scans_of(truth, world(rng), rng)
    odometry = drifting(truth, 0.15, 0.03)
    return truth, scans, odometry, build_map(odometry, scans=scans, settings=MAPPED)


def test_drift_of_a_loop_is_taken_out(walked):
    truth, _, odometry, found = walked
    before, after = (rmse_m(t.position_m, truth[:, :3, 3]) for t in (odometry, found.trajectory))
    print(f"before {before:.3f} m, after {after:.3f} m, {found.accepted.sum()} of {len(found.closures)} closures")
    assert before > 0.2
    assert after < 0.05


def test_every_pose_and_stamp_is_kept(walked):
    _, scans, odometry, found = walked
    assert np.array_equal(found.trajectory.stamp_s, odometry.stamp_s)
    assert found.n_scans == len(scans)
    assert found.cloud_bytes > 0


def test_accepted_closures_are_true(walked):
    truth, _, _, found = walked
    keyframe = truth[found.keyframes.source]
    assert found.accepted.sum() >= 3
    for c in np.array(found.closures)[found.accepted]:
        error = rigid.log(rigid.inverse(c.T_first_second) @ rigid.inverse(keyframe[c.first]) @ keyframe[c.second])
        assert error @ c.information @ error < 22.5  # 99.9 % of six degrees of freedom


def test_drift_beyond_the_kind_s_is_said(walked):
    found = walked[3]
    assert found.loops.noise_factor > 1.0
    assert any("drifts" in text for text in found.warnings)


def test_without_a_loop_nothing_changes(walked):
    truth, scans, _, _ = walked
    odometry = drifting(truth[:30], 0.02, 0.01)
    found = build_map(odometry, scans=scans[:30], settings=dataclasses.replace(MAPPED, refine=False))
    assert found.trajectory is odometry
    assert len(found.closures) == 0


def test_real_sixteen_scans_without_a_loop():
    with np.load(data_root() / "lidar" / "kitti00_first16" / "scans_voxel10cm.npz") as packed:
        xyz, offsets, times = packed["xyz"], packed["offsets"], packed["times"]
        T_velo_to_cam = np.vstack([packed["Tr_velo_to_cam"], [0.0, 0.0, 0.0, 1.0]])
        cam = np.tile(np.eye(4), (len(times), 1, 1))
        cam[:, :3] = packed["gt_cam0_poses"]
        scale = float(packed["scale"])
    truth = rigid.inverse(T_velo_to_cam) @ cam @ T_velo_to_cam
    scans = [
        Scan(float(times[k]), xyz[offsets[k] : offsets[k + 1] : 4] * scale, None, None, "kitti", k)
        for k in range(len(times))
    ]
    odometry = Trajectory(times, *rigid.parts(truth))
    found = build_map(odometry, scans=scans, settings=MapSettings(threads=1, refine=False))
    assert found.trajectory is odometry


def test_nothing_to_map_with_is_refused(walked):
    with pytest.raises(ScanError, match="neither LiDAR scans nor RGB-D"):
        build_map(walked[2])


def test_scans_of_another_clock_are_refused(walked):
    _, scans, odometry, _ = walked
    late = [Scan(1e9 + s.stamp_s, s.points_m, None, None, s.source, s.index) for s in scans[:25]]
    with pytest.raises(ScanError, match="25 of 25 scans have stamps outside"):
        build_map(odometry, scans=late)
