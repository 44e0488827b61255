"""One LiDAR scan of a room: ranges to planes in closed form, times, motion, noise, losses."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data.scan import Scan
from jaxgeo.errors import InputError
from jaxgeo.simulate.sensors.lidar import Lidar, RingErrors, render_scan, ring_errors
from jaxgeo.simulate.sensors.mesh import box
from jaxgeo.simulate.sensors.ray_casting import Scene
from jaxgeo.simulate.sensors.texture import PLASTER

PERFECT = Lidar(rings=8, columns=90, rate_hz=10.0, max_range_m=1000.0, range_sigma_m=0.0, drop_out=0.0)
NONE = RingErrors(np.zeros(8), np.zeros(8))
LOW_M, HIGH_M = np.array([-6.0, -4.0, -1.5]), np.array([9.0, 5.0, 3.0])


@pytest.fixture(scope="module")
def room() -> Scene:
    return Scene(box(LOW_M.tolist(), HIGH_M.tolist(), PLASTER))


def standing(after_s: np.ndarray) -> RigidTransform:
    return RigidTransform.from_translation(np.tile([0.5, -0.3, 0.2], (len(after_s), 1)))


def moving(after_s: np.ndarray) -> RigidTransform:
    """4 m/s and 2 rad/s."""
    turn = Rotation.from_rotvec(np.outer(after_s, [0.1, -0.2, 2.0]))
    return RigidTransform.from_components(np.outer(after_s, [4.0, 1.0, 0.0]), turn)


def scan_of(lidar: Lidar, room: Scene, poses, seed: int = 0, errors: RingErrors = NONE) -> Scan:
    return render_scan(np.random.default_rng(seed), lidar, errors, room, poses, 100.0, 0)


def distance_to_walls_m(points_m: np.ndarray) -> np.ndarray:
    return np.abs(np.concatenate([points_m - LOW_M, HIGH_M - points_m], axis=1)).min(axis=1)


def test_ranges_are_those_to_the_planes(room):
    scan = scan_of(PERFECT, room, standing)
    assert len(scan) == 8 * 90
    origin_m = np.array([0.5, -0.3, 0.2])
    ray = scan.points_m / np.linalg.norm(scan.points_m, axis=1, keepdims=True)
    to_planes_m = (np.where(ray > 0, HIGH_M, LOW_M) - origin_m) / np.where(ray == 0, 1e-300, ray)
    assert np.allclose(np.linalg.norm(scan.points_m, axis=1), np.abs(to_planes_m).min(axis=1), atol=2e-5)
    elevation_rad = np.arcsin(ray[:, 2]).reshape(90, 8)
    assert np.allclose(elevation_rad, PERFECT.elevation_rad(), atol=1e-12)


def test_points_are_where_the_moving_sensor_saw_them_at_their_own_times(room):
    scan = scan_of(PERFECT, room, moving)
    assert scan.time_s is not None
    assert np.all(np.diff(scan.time_s) >= 0)
    assert scan.time_s[0] == 0.0
    assert 0.09 < scan.time_s[-1] < 0.1
    assert distance_to_walls_m(moving(scan.time_s).apply(scan.points_m)).max() < 2e-5
    # Taken as of one time, they bend.
    assert distance_to_walls_m(scan.points_m).max() > 0.2


def test_noise_lies_along_the_rays(room):
    noisy = dataclasses.replace(PERFECT, range_sigma_m=0.03)
    clean, scan = scan_of(PERFECT, room, standing), scan_of(noisy, room, standing)
    length_m = np.linalg.norm(clean.points_m, axis=1)
    along_m = np.sum(scan.points_m * clean.points_m, axis=1) / length_m
    assert np.std(along_m - length_m) == pytest.approx(0.03, rel=0.1)
    assert np.allclose(np.cross(scan.points_m, clean.points_m), 0.0, atol=1e-9)


def test_rings_keep_their_errors(room):
    errors = RingErrors(np.linspace(-0.05, 0.05, 8), np.linspace(0.01, -0.02, 8))
    clean = scan_of(PERFECT, room, standing).points_m.reshape(90, 8, 3)
    scan = scan_of(PERFECT, room, standing, errors=errors).points_m.reshape(90, 8, 3)
    assert np.allclose(np.cross(scan, clean), 0.0, atol=1e-9)  # given along the rays that the sensor believes in
    range_m = np.linalg.norm(scan, axis=2)
    elevation_rad = PERFECT.elevation_rad() + errors.elevation_rad
    # The wall ahead, which the middle column sees: its distance over the cosine of the true elevation.
    assert range_m[45, 3] == pytest.approx(8.5 / np.cos(elevation_rad[3]) + errors.range_m[3], abs=1e-4)
    drawn = ring_errors(np.random.default_rng(0), dataclasses.replace(PERFECT, rings=4000))
    assert drawn.range_m.std() == pytest.approx(PERFECT.ring_range_sigma_m, rel=0.05)
    assert drawn.elevation_rad.std() == pytest.approx(PERFECT.ring_elevation_sigma_rad, rel=0.05)


def test_echoes_are_lost_by_chance_by_range_and_by_how_faint_they_are(room):
    few = scan_of(dataclasses.replace(PERFECT, drop_out=0.3), room, standing)
    assert len(few) == pytest.approx(0.7 * 720, rel=0.08)
    near = scan_of(dataclasses.replace(PERFECT, min_range_m=5.0, max_range_m=8.0), room, standing)
    length_m = np.linalg.norm(near.points_m, axis=1)
    assert length_m.min() >= 5.0
    assert length_m.max() <= 8.0
    assert near.intensity is not None
    assert near.intensity.max() <= 255.0
    everything = scan_of(PERFECT, room, standing)
    far = scan_of(dataclasses.replace(PERFECT, max_range_m=10.0), room, standing)
    within = np.linalg.norm(everything.points_m, axis=1) <= 10.0
    assert len(far) < within.sum()  # grazing, near the end of its range


def test_the_same_numbers_from_the_same_seed(room):
    lidar = dataclasses.replace(PERFECT, range_sigma_m=0.02, drop_out=0.1)
    one, two, other = (scan_of(lidar, room, moving, seed) for seed in (5, 5, 6))
    assert np.array_equal(one.points_m, two.points_m)
    assert np.array_equal(one.intensity, two.intensity)
    assert not np.array_equal(one.points_m[:50], other.points_m[:50])


@pytest.mark.parametrize("wrong", [{"rings": 0}, {"rate_hz": 0.0}, {"drop_out": 1.0}, {"min_range_m": 70.0}])
def test_impossible_sensors_are_refused(wrong):
    with pytest.raises(InputError, match=r"LiDAR: .*expected"):
        Lidar(**wrong)
