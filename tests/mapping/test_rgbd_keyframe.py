"""Depth gates and keyframes, on a room whose walls are known."""

import dataclasses

import numpy as np
import pytest
from rgbd_room import body_pose, looking, off_walls_m, photograph, pinhole, walls

from jaxgeo.data import Camera
from jaxgeo.errors import ScanError
from jaxgeo.geometry import rigid
from jaxgeo.mapping.depth_gates import DepthGates, gated_depth
from jaxgeo.mapping.image_features import SiftFeatures
from jaxgeo.mapping.rgbd_camera import frames_camera, rgbd_camera
from jaxgeo.mapping.rgbd_keyframe import make_keyframe

WALLS = walls(0)
METHOD = SiftFeatures()


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("none", ()), ("radtan", (-0.2, 0.05, 0.001, -0.002)), ("equidistant", (-0.03, 0.004, 0.0, 0.0))],
)
def test_points_and_features_lie_on_the_walls_through_any_lens(model, distortion):
    camera = pinhole((0.1, -0.2, 0.3), (0.4, -1.1, 0.3), model, distortion)
    T_map_cam = looking((0.2, -0.1, 0.1), 0.6, 0.2)
    T_map_body = body_pose(T_map_cam, camera)
    keyframe = make_keyframe(photograph(WALLS, T_map_cam, camera), camera, METHOD, voxel_m=0.05)
    points = rigid.apply(T_map_body, keyframe.points_m)
    assert off_walls_m(points).max() < 1e-5
    assert len(np.unique(np.floor(keyframe.points_m / 0.05), axis=0)) > 0.99 * len(points)
    known = np.isfinite(keyframe.depth_m)
    assert known.mean() > 0.8
    rays = np.column_stack([keyframe.rays[known], np.ones(known.sum())])
    seen = rigid.apply(T_map_cam, rays * keyframe.depth_m[known][:, None])
    assert np.median(off_walls_m(seen)) < 0.003
    assert off_walls_m(seen).max() < 0.02  # the median over 3 x 3 pixels, of a slanting wall
    assert 0 < keyframe.nbytes < 2e6


def test_gates_reject_ranges_edges_and_grazing_surfaces():
    camera = pinhole()
    flat = np.full((240, 320), 2.0, dtype=np.float32)
    flat[:60], flat[60:120] = 0.1, 9.0
    flat[200, 100] = np.nan
    flat[180:, 200:] = 1.0
    passed = gated_depth(flat, camera, DepthGates(), "frame 1") > 0.0
    assert not passed[:121].any()
    assert not passed[200, 100]
    assert not passed[179:181, 201:].any()  # either side of the step
    assert not passed[181:, 199:201].any()
    passed[199:202, 99:102] = True  # beside the one that is missing
    assert passed[122:178].all()
    assert passed[182:, 202:].all()


def test_the_incidence_gate_follows_the_angle():
    camera = pinhole()
    normal = np.array([np.sin(1.0), 0.0, -np.cos(1.0)])  # 1.0 rad off the axis
    rays = np.concatenate([camera.rays, np.ones((240, 320, 1))], axis=-1)
    depth = (-1.5 * np.cos(1.0) / (rays @ normal)).astype(np.float32)
    angle = np.arccos(np.abs(rays @ normal) / np.linalg.norm(rays, axis=-1))
    gates = DepthGates(min_m=0.0, max_m=100.0, edge_share=1.0, max_incidence_rad=1.0)
    passed = gated_depth(depth, camera, gates, "frame 1")[10:-10, 10:-10] > 0.0
    sure = np.abs(angle - 1.0)[10:-10, 10:-10] > 0.02
    np.testing.assert_array_equal(passed[sure], (angle < 1.0)[10:-10, 10:-10][sure])


def test_images_of_another_size_and_cameras_without_one_are_refused():
    camera = pinhole()
    frame = photograph(WALLS, looking((0.0, 0.0, 0.0), 0.0), camera)
    small = dataclasses.replace(frame, image=frame.image[:120], source="film.mcap: frame 7")
    with pytest.raises(ScanError, match=r"film.mcap: frame 7: image of 320 x 120 pixels, .*320 x 240"):
        make_keyframe(small, camera, METHOD)
    unknown = Camera(np.ones(4), "none", np.zeros(0), None, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(ScanError, match="its resolution is not known"):
        rgbd_camera(unknown)
    with pytest.raises(ScanError, match="calibrated for 320 x 240 pixels, but the frames have 640 x 480"):
        rgbd_camera(camera.camera, (640, 480))


def test_gates_that_leave_no_range_are_refused():
    with pytest.raises(ScanError, match=r"from 3.0 m to 1.0 m is no range"):
        DepthGates(min_m=3.0, max_m=1.0)


def test_a_camera_takes_the_resolution_of_the_frames():
    own = pinhole().camera
    unknown = Camera(own.intrinsics_px, "none", np.zeros(0), None, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    frame = photograph(WALLS, looking((0.0, 0.0, 0.0), 0.0), pinhole())
    assert frames_camera(unknown, [frame]).resolution_px == (320, 240)
    with pytest.raises(ScanError, match="the source holds none"):
        frames_camera(unknown, [])
