import numpy as np
from box_world import drive

from jaxgeo.geometry.rigid import exp, inverse, log
from jaxgeo.odometry.registration import VoxelMap, prepare_cloud, register
from jaxgeo.odometry.scan_map import ScanMap
from jaxgeo.odometry.settings import OdometrySettings

STILL = np.zeros(6)
OFF = np.array([0.3, -0.2, 0.05, 0.01, -0.01, 0.08])


def test_a_known_motion_is_found_against_a_cloud_and_against_a_map():
    scans, _ = drive(2, STILL)
    target, source = (prepare_cloud(scan.points_m, 0.25) for scan in scans)
    voxels = VoxelMap(1.0)
    voxels.insert(target, np.eye(4))
    for found in (register(target, source, exp(OFF), 2.0), register(voxels, source, exp(OFF), 2.0)):
        assert found.converged
        assert found.inlier_share > 0.8
        np.testing.assert_allclose(log(found.T_target_source), 0.0, atol=0.02)


def test_the_information_is_translation_first_in_the_sources_frame():
    # A floor alone holds height, roll and pitch; turning the source by 90 deg about x makes its y axis the upright one
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-10, 10, (4000, 2)), rng.normal(0.0, 0.005, 4000)])
    turned = exp(np.array([0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0]))
    source = floor @ turned[:3, :3]
    found = register(prepare_cloud(floor, 0.5), prepare_cloud(source, 0.5), turned, 1.0)
    held = np.diag(found.information)
    assert held[1] > 50.0 * max(held[0], held[2])
    assert min(held[3], held[5]) > 10.0 * held[4]


def test_along_a_floor_the_expectation_stays_and_across_it_the_scan_decides():
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-10, 10, (4000, 2)), np.zeros(4000)])
    there = ScanMap(0.5, OdometrySettings())
    cloud = there.prepare(floor)
    there.insert(cloud, np.eye(4))
    expected = exp(np.array([0.6, 0.3, 0.1, 0.0, 0.0, 0.0]))
    found = there.match(cloud, expected, np.repeat([0.1, 0.05], 3))
    off = log(inverse(expected) @ found.T_map_lidar)
    np.testing.assert_allclose(off[2], -0.1, atol=0.005)
    np.testing.assert_allclose(off[:2], 0.0, atol=0.02)
    assert found.held < 0.05


def test_nothing_in_reach_leaves_the_expectation():
    scans, _ = drive(1, STILL)
    there = ScanMap(0.5, OdometrySettings())
    cloud = there.prepare(scans[0].points_m)
    there.insert(cloud, np.eye(4))
    far = exp(np.array([500.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found = there.match(cloud, far, np.repeat([0.1, 0.05], 3))
    np.testing.assert_allclose(found.T_map_lidar, far, atol=1e-9)
    assert (found.inlier_share, found.held) == (0.0, 0.0)
