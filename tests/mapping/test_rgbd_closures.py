"""Closures of RGB-D keyframes: a walk round the simulated room, and real frames with known poses."""

import dataclasses

import cv2
import numpy as np
import pytest
from data_root import data_root
from rgbd_room import body_pose, looking, photograph, pinhole, walls

from jaxgeo.data import Camera, RgbdFrame
from jaxgeo.geometry import rigid
from jaxgeo.mapping.image_features import SiftFeatures
from jaxgeo.mapping.rgbd_alignment import align_keyframes
from jaxgeo.mapping.rgbd_camera import rgbd_camera
from jaxgeo.mapping.rgbd_candidates import CandidateSettings, rgbd_candidates
from jaxgeo.mapping.rgbd_closures import rgbd_closures
from jaxgeo.mapping.rgbd_keyframe import make_keyframe

METHOD = SiftFeatures(600)


@pytest.fixture(scope="module")
def walk():
    """Sixteen keyframes, one turn and a quarter in 75 s: the last four see what the first four saw."""
    camera, textures = pinhole((0.1, 0.0, 0.2), (0.0, 0.0, 0.5)), walls(0)
    poses = [looking((0.3 * np.cos(0.52 * k), 0.3 * np.sin(0.52 * k), 0.05), 0.5236 * k) for k in range(16)]
    frames = [photograph(textures, T, camera, 5.0 * k, 0.002, k) for k, T in enumerate(poses)]
    keyframes = [make_keyframe(frame, camera, METHOD) for frame in frames]
    return camera, keyframes, np.array([body_pose(T, camera) for T in poses])


def test_the_walk_is_closed_where_it_returns(walk):
    camera, keyframes, T_map_body = walk
    done = []
    closures, refused = rgbd_closures(keyframes, camera, METHOD, on_progress=lambda k, n: done.append((k, n)))
    found = {(one.first, one.second) for one in closures}
    assert {(0, 12), (1, 13), (2, 14), (3, 15)} <= found
    for one in closures:
        off = rigid.log(
            rigid.inverse(one.T_first_second) @ rigid.inverse(T_map_body[one.first]) @ T_map_body[one.second]
        )
        assert np.linalg.norm(off[:3]) < 0.03, (one.first, one.second)
        assert np.linalg.norm(off[3:]) < 0.02
        assert keyframes[one.second].stamp_s - keyframes[one.first].stamp_s >= 10.0
        assert one.kind == "rgbd"
        assert 0.0 < one.score <= 1.0
    assert len(closures) + sum(refused.values()) == len(done) == done[-1][1]


def test_keyframes_near_in_time_are_no_candidates(walk):
    _, keyframes, _ = walk
    pairs = rgbd_candidates(keyframes, None, CandidateSettings(min_gap_s=30.0))
    assert pairs
    assert all(second - first >= 6 for first, second in pairs)
    assert pairs == sorted(set(pairs))
    assert rgbd_candidates(keyframes[:1]) == []


def test_the_trajectory_proposes_what_likeness_alone_does_not(walk):
    camera, keyframes, T_map_body = walk
    by_place = CandidateSettings(most_alike=0)
    T_map_cam = T_map_body @ camera.T_body_cam
    pairs = rgbd_candidates(keyframes, T_map_cam, by_place)
    assert (0, 12) in pairs
    assert rgbd_candidates(keyframes, None, by_place) == []
    axis = T_map_cam[:, :3, 2]
    assert all(axis[first] @ axis[second] >= 0.5 for first, second in pairs)
    away = T_map_cam.copy()
    away[8:, 0, 3] += 50.0
    assert not any(first < 8 <= second for first, second in rgbd_candidates(keyframes, away, by_place))


CAMERA = rgbd_camera(
    Camera(np.array([585.0, 585.0, 320.0, 240.0]), "none", np.zeros(0), (640, 480), np.zeros(3), np.eye(4)[0])
)


@pytest.fixture(scope="module")
def kitchen():
    folder = data_root() / "rgbd_7scenes_redkitchen"
    keyframes, poses = [], []
    for number in (0, 15, 30):
        name = folder / f"frame-{number:06d}"
        depth = cv2.imread(f"{name}.depth.png", cv2.IMREAD_UNCHANGED).astype(np.float32)
        depth[depth == 65535] = 0.0
        frame = RgbdFrame(number / 30.0, cv2.imread(f"{name}.color.jpg"), depth / 1000.0, str(name), number)
        keyframes.append(make_keyframe(frame, CAMERA, SiftFeatures()))
        poses.append(np.loadtxt(f"{name}.pose.txt"))
    return keyframes, poses


def test_real_frames_close_with_small_errors(kitchen):
    keyframes, poses = kitchen
    closures, _ = rgbd_closures(keyframes, CAMERA, METHOD, candidates=CandidateSettings(min_gap_s=0.4))
    assert {(0, 1), (1, 2)} <= {(one.first, one.second) for one in closures}
    for one in closures:
        off = rigid.log(rigid.inverse(one.T_first_second) @ np.linalg.inv(poses[one.first]) @ poses[one.second])
        assert np.linalg.norm(off[:3]) < 0.05
        assert np.linalg.norm(off[3:]) < np.deg2rad(2.5)


def test_photographs_of_another_room_close_nothing(kitchen):
    keyframes, _ = kitchen
    pictures = sorted((data_root() / "tags" / "swatbotics_mapping").glob("*.JPG"))[::18]
    assert len(pictures) == 4
    for number, picture in enumerate(pictures):
        image = cv2.resize(cv2.imread(str(picture)), (640, 480))
        features = SiftFeatures().extract(image)
        other = dataclasses.replace(
            keyframes[number % 3], features=features, rays=(features.points_px - [320, 240]) / 585
        )
        other = dataclasses.replace(other, depth_m=np.full(len(features), 2.0))
        for keyframe in keyframes:
            matches = METHOD.match(keyframe.features, other.features)
            assert align_keyframes(keyframe, other, matches, CAMERA)[0] is None
