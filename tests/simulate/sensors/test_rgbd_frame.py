"""One RGB-D frame: depth of planes in closed form, its noise, the marker where the detector reads it."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data.scan import RgbdFrame
from jaxgeo.detect.detector import Detector, DetectorSettings
from jaxgeo.detect.mask import MaskSettings
from jaxgeo.errors import InputError
from jaxgeo.simulate import UGV
from jaxgeo.simulate.marker_image import marker_corners_px
from jaxgeo.simulate.sensors.board import MARGIN_S, MarkerVisit
from jaxgeo.simulate.sensors.mesh import box, joined
from jaxgeo.simulate.sensors.rgbd import Marker, RgbdCamera, placed_marker, render_frame
from jaxgeo.simulate.sensors.rig import sensor_rig
from jaxgeo.simulate.sensors.texture import BRICK, GRASS
from jaxgeo.simulate.sensors.world import World

SENSOR = RgbdCamera(resolution_px=(320, 240), focal_px=230.0, disparity_sigma_px=0.0, disparity_step_px=1e-6)
# Looks north from the origin, level: x of the image is east, y down.
AHEAD = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
FACING_SOUTH = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
WALL_M, FLOOR_M = 5.0, -1.5
VISIT = MarkerVisit("A", 10.0, 20.0, RigidTransform.from_components([0.2, 2.5, -0.1], FACING_SOUTH))
LENS = (-0.12, 0.03, 0.001, -0.002)


@pytest.fixture(scope="module")
def world() -> World:
    wall = box([-30.0, WALL_M, -3.0], [30.0, WALL_M + 0.5, 3.0], BRICK)
    floor = box([-30.0, -5.0, FLOOR_M - 0.2], [30.0, WALL_M, FLOOR_M], GRASS)
    return World(0, joined([wall, floor]))


def standing(after_s: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(np.zeros((len(after_s), 3)), Rotation.concatenate([AHEAD] * len(after_s)))


def frame_of(world: World, sensor: RgbdCamera, visit: MarkerVisit | None = None, seed: int = 0) -> RgbdFrame:
    camera = sensor_rig(UGV, sensor.resolution_px, sensor.focal_px, sensor.distortion).camera
    return render_frame(np.random.default_rng(seed), sensor, camera, Marker(), world, visit, standing, 50.0, 0)


@pytest.mark.parametrize("distortion", [(), LENS], ids=["pinhole", "radtan"])
def test_depth_is_that_of_wall_and_floor_along_the_optical_axis(world, distortion):
    from jaxgeo.associate.camera_model import undistort

    sensor = dataclasses.replace(SENSOR, distortion=distortion)
    camera = sensor_rig(UGV, sensor.resolution_px, sensor.focal_px, distortion).camera
    frame = frame_of(world, sensor)
    u, v = np.meshgrid(np.arange(320), np.arange(240))
    rays, _ = undistort(np.column_stack([u.ravel(), v.ravel()]).astype(float), camera)
    down = rays[:, 1].reshape(240, 320)
    with np.errstate(divide="ignore"):
        expected_m = np.where(down > -FLOOR_M / WALL_M, -FLOOR_M / down, WALL_M)
    seen = frame.depth_m > 0
    assert seen.mean() > 0.9
    assert np.allclose(frame.depth_m[seen], expected_m[seen], atol=2e-3)
    assert frame.image.shape == (240, 320, 3)
    assert frame.image.std() > 10


def test_depth_of_the_board_is_the_markers_plane(world):
    frame = frame_of(world, SENSOR, VISIT)
    u, v = (SENSOR.focal_px * np.array([0.2, 0.1]) / 2.5 + [161.2, 117.2]).astype(int)
    assert np.allclose(frame.depth_m[v - 20 : v + 20, u - 20 : u + 20], 2.5, atol=2e-3)


def test_noise_of_depth_grows_with_its_square(world):
    noisy = dataclasses.replace(SENSOR, disparity_sigma_px=0.05)
    near = frame_of(world, noisy, VISIT).depth_m[100:140, 160:200]
    far = frame_of(world, noisy).depth_m[40:80, 60:260]
    for depth_m, at_m in ((near, 2.5), (far, WALL_M)):
        assert depth_m.std() == pytest.approx(0.05 * at_m**2 / SENSOR.disparity_px_m, rel=0.35)
    steps = dataclasses.replace(SENSOR, disparity_step_px=0.25)
    assert len(np.unique(np.round(frame_of(world, steps).depth_m[40:80, 60:260], 4))) == 1


def test_depth_ends_at_its_range_and_at_edges(world):
    short = dataclasses.replace(SENSOR, max_range_m=4.0)
    depth_m = frame_of(world, short, VISIT).depth_m
    assert depth_m.max() <= 4.0
    assert (depth_m[60:80, 20:60] == 0).all()
    edges = frame_of(world, SENSOR, VISIT).depth_m[117] == 0  # across the board: its two sides
    assert 2 <= edges.sum() <= 12


@pytest.mark.parametrize("distortion", [(), LENS], ids=["pinhole", "radtan"])
def test_the_detector_reads_the_marker_where_it_is(world, distortion):
    sensor = dataclasses.replace(SENSOR, resolution_px=(640, 480), focal_px=460.0, distortion=distortion)
    camera = sensor_rig(UGV, sensor.resolution_px, sensor.focal_px, distortion).camera
    detector = Detector(DetectorSettings(families=("apriltag_36h11",), mask=MaskSettings()))
    found = detector(frame_of(world, sensor, VISIT).image, camera)
    assert found.marker.tolist() == [7]
    placed = placed_marker(Marker(), VISIT, standing(np.zeros(1))[0])
    assert np.abs(found.corners_px[0] - marker_corners_px(camera, placed)).max() < 0.5
    assert len(detector(frame_of(world, sensor).image, camera).marker) == 0


def test_places_have_their_own_camouflage_and_the_same_marker(world):
    there = dataclasses.replace(VISIT, location="B")
    a, b = (frame_of(world, SENSOR, visit).image.astype(int) for visit in (VISIT, there))
    different = np.abs(a - b).max(axis=2) > 40
    assert different[70:170, 130:230].mean() > 0.1
    assert different[:40].mean() < 0.01


def test_a_board_behind_a_wall_shows_no_marker():
    screen = World(0, box([-3.0, 1.0, -3.0], [3.0, 1.2, 3.0], BRICK))
    without, behind = frame_of(screen, SENSOR).image, frame_of(screen, SENSOR, VISIT).image
    assert np.array_equal(without, behind)


def test_the_same_pixels_from_the_same_seed(world):
    one, two, other = (frame_of(world, RgbdCamera(), VISIT, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.image, two.image)
    assert np.array_equal(one.depth_m, two.depth_m)
    assert not np.array_equal(one.image, other.image)


def test_a_board_stands_from_shortly_before_its_visit_until_shortly_after():
    shown = [VISIT.shows(time_s) for time_s in (10 - MARGIN_S - 0.1, 10 - MARGIN_S + 0.1, 15.0, 20 + MARGIN_S + 0.1)]
    assert shown == [False, True, True, False]


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"visit_rate_hz": 100.0}, {"max_range_m": 70.0}])
def test_impossible_cameras_are_refused(wrong):
    with pytest.raises(InputError, match=r"RGB-D camera: .*expected"):
        RgbdCamera(**wrong)
