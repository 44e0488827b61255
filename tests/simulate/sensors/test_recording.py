"""Recordings as files and as bags: what they hold, read back through the project's own readers."""

import dataclasses
import hashlib
import json
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from jaxgeo.associate.camera_model import undistort
from jaxgeo.errors import InputError
from jaxgeo.io.frames.bag import BagFrames
from jaxgeo.io.rgbd.source import open_rgbd
from jaxgeo.io.rig_yaml import read_rig
from jaxgeo.io.scans.source import open_scans
from jaxgeo.io.survey_csv import read_survey
from jaxgeo.io.tum import read_tum
from jaxgeo.io.yaml_file import read_yaml
from jaxgeo.simulate import UAV, UGV
from jaxgeo.simulate.layout import CRS
from jaxgeo.simulate.sensors import recording as recording_module
from jaxgeo.simulate.sensors import rendering
from jaxgeo.simulate.sensors.bag_file import COLOR, DEPTH, write_recording_bag
from jaxgeo.simulate.sensors.board import MARGIN_S
from jaxgeo.simulate.sensors.files import write_recording
from jaxgeo.simulate.sensors.lidar import Lidar
from jaxgeo.simulate.sensors.recording import Recording, Renderer, record
from jaxgeo.simulate.sensors.rgbd import RgbdCamera
from jaxgeo.simulate.sensors.world import World, world_of

LIDAR = Lidar(rings=8, columns=120, rate_hz=5.0, ring_range_sigma_m=0.0, ring_elevation_sigma_rad=0.0)
CAMERA = RgbdCamera(resolution_px=(160, 120), focal_px=115.0, rate_hz=2.0, visit_rate_hz=4.0)
SPARSE = dataclasses.replace(CAMERA, rate_hz=0.5, visit_rate_hz=1.0)


def short(camera: RgbdCamera | None = SPARSE, duration_s: float = 4.4) -> Recording:
    return record(0, UAV, lidar=LIDAR, camera=camera, duration_s=duration_s)


def hashes(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def world() -> World:
    return world_of(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "uav"
    done = []
    recording = short()
    config = write_recording(recording, folder, on_item=lambda: done.append(None))
    assert config == folder / "config.yaml"
    assert len(done) == len(recording.scan_s) + len(recording.frame_s)
    return folder


def test_files_read_back(folder):
    config = read_yaml(folder / "config.yaml")
    assert config["simulated"] is True
    assert config["crs"] == CRS
    assert "trajectories" not in config
    scans = list(open_scans(folder / config["scans"]["path"]))
    assert [scan.stamp_s - 1.7e9 for scan in scans] == pytest.approx(np.arange(22) / 5, abs=1e-6)
    assert all(scan.time_s is not None and scan.intensity is not None and len(scan) > 300 for scan in scans)
    frames = list(open_rgbd(folder / config["rgbd"]["path"]))
    assert [frame.stamp_s - 1.7e9 for frame in frames] == pytest.approx(short().frame_s.tolist(), abs=1e-6)
    rig = read_rig(folder / config["rig"]["file"])
    assert rig.cameras[config["rgbd"]["camera"]].resolution_px == (160, 120)
    survey = read_survey(folder / "survey.csv", crs=CRS)
    assert survey.name == ("A", "B", "C", "D", "E", "F")
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["simulated"] is True
    assert truth["scans"] == 22
    assert config["visits"]["order"] == [visit["location"] for visit in truth["visits"]] == ["A"]


def off_the_world(world: World, recording: Recording, origin_m: np.ndarray, point_m: np.ndarray) -> np.ndarray:
    """How far points lie beyond what their rays meet first in the true world, in shares of their ranges."""
    scene = world.scene(recording.visits[0])
    return np.abs(scene.cast(origin_m.astype(np.float32), (point_m - origin_m).astype(np.float32)).t - 1.0)


def test_scans_and_depths_put_in_the_world_by_the_files_alone_lie_on_it(folder, world):
    """Body poses of the truth, places of the sensors of config and rig."""
    config, truth = read_yaml(folder / "config.yaml"), read_tum(folder / "truth.tum")
    mount = config["scans"]["T_body_lidar"]
    attitude = Rotation.from_quat(mount["quat_wxyz"], scalar_first=True)
    T_body_lidar = RigidTransform.from_components(mount["t_m"], attitude)
    camera = read_rig(folder / "rig.yaml").cameras["cam0"]
    attitude = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True)
    T_body_cam = RigidTransform.from_components(camera.t_body_cam_m, attitude)

    def pose(stamp_s: np.ndarray) -> RigidTransform:
        rotation = Slerp(truth.stamp_s, Rotation.from_quat(truth.quat_wxyz, scalar_first=True))(stamp_s)
        position_m = [np.interp(stamp_s, truth.stamp_s, axis) for axis in truth.position_m.T]
        return RigidTransform.from_components(np.column_stack(position_m), rotation)

    recording = short()
    for scan in open_scans(folder / "scans.npz"):
        assert scan.time_s is not None
        sensor = pose(scan.stamp_s + scan.time_s) * T_body_lidar
        off = off_the_world(world, recording, sensor.translation, sensor.apply(scan.points_m))
        assert np.percentile(off * np.linalg.norm(scan.points_m, axis=1), 80) < 0.04
    for frame in open_rgbd(folder):
        v, u = np.nonzero(frame.depth_m)
        rays, _ = undistort(np.column_stack([u, v]).astype(float), camera)
        sensor = (pose(np.array([frame.stamp_s])) * T_body_cam)[0]
        seen_m = sensor.apply(np.column_stack([rays, np.ones(len(rays))]) * frame.depth_m[v, u][:, None])
        origin_m = np.tile(sensor.translation, (len(seen_m), 1))
        assert np.percentile(off_the_world(world, recording, origin_m, seen_m), 80) < 0.02


def test_the_bag_holds_the_same(folder, tmp_path):
    config = read_yaml(write_recording_bag(short(), tmp_path / "bagged"))
    bag = tmp_path / "bagged" / config["scans"]["path"]
    packed, bagged = list(open_scans(folder / "scans.npz")), list(open_scans(bag, topic=config["scans"]["topic"]))
    assert len(packed) == len(bagged)
    for one, other in zip(packed, bagged, strict=True):
        assert one.stamp_s == other.stamp_s
        assert np.allclose(one.points_m, other.points_m, atol=6e-4)
        assert np.allclose(one.time_s, other.time_s, atol=1e-6)
        assert np.array_equal(one.intensity, other.intensity)
    frames = list(open_rgbd(folder))
    images = list(BagFrames(bag, topics=config["sightings"]["source"]["topics"]))
    assert [image.camera for image in images] == ["cam0"] * len(frames)
    assert all(np.array_equal(one.image, other.image) for one, other in zip(frames, images, strict=True))
    assert config["rgbd"]["topics"] == {"color": COLOR, "depth": DEPTH}
    pairs = list(open_rgbd(bag, topics=config["rgbd"]["topics"]))
    assert all(np.array_equal(one.depth_m, other.depth_m) for one, other in zip(frames, pairs, strict=True))
    with pytest.raises(InputError, match="there is a bag already"):
        write_recording_bag(short(), tmp_path / "bagged")


def test_several_workers_give_the_same_in_the_same_order(monkeypatch):
    """Threads in the place of processes, which take seconds to start; they get what survives pickling."""

    def threads(workers, start, arguments):
        return ThreadPoolExecutor(workers, initializer=start, initargs=pickle.loads(pickle.dumps(arguments)))

    recording = short(camera=None, duration_s=4.0)
    monkeypatch.setattr(rendering, "WorkerPool", threads)
    for one, other in zip(rendering.rendered(recording, 1), rendering.rendered(recording, 2), strict=True):
        assert one.index == other.index
        assert np.array_equal(one.points_m, other.points_m)


def test_both_sessions_see_the_same_world_from_different_heights(world):
    for layout in (UAV, UGV):
        recording = record(0, layout, lidar=dataclasses.replace(LIDAR, range_sigma_m=0.0))
        scan = Renderer(recording).scan(int(60.0 * LIDAR.rate_hz))
        assert scan.time_s is not None
        sensor = recording.walk.pose(60.0 + scan.time_s) * recording.rig.T_body_lidar
        off = off_the_world(world, recording, sensor.translation, sensor.apply(scan.points_m))
        assert np.percentile(off, 95) < 1e-4
    heights = [record(0, layout).truth().position_m[:, 2].mean() for layout in (UAV, UGV)]
    assert heights[0] - heights[1] == pytest.approx(UAV.rig_height_m - UGV.rig_height_m, abs=0.3)


def test_frames_are_denser_where_a_marker_is_shown():
    recording = record(0, UGV, camera=CAMERA)
    assert recording.order == UGV.order
    for visit in recording.visits:
        inside = (recording.frame_s > visit.arrive_s - MARGIN_S) & (recording.frame_s < visit.leave_s + MARGIN_S)
        assert np.allclose(np.diff(recording.frame_s[inside]), 0.25)
    assert np.diff(recording.frame_s).max() <= 0.5 + 1e-6
    assert np.diff(recording.frame_s).min() > 0.0


def test_a_cut_recording_tells_only_the_visits_it_holds():
    whole = record(0, UAV)
    cut = record(0, UAV, duration_s=50.0)
    assert cut.order == ("A", "B")
    assert len(cut.scan_s) == 250
    assert cut.truth().stamp_s[-1] <= 1.7e9 + 50.0
    assert set(np.round(cut.scan_s + 1.7e9, 6)) <= set(np.round(cut.truth().stamp_s, 6))
    assert np.array_equal(cut.scan_s, whole.scan_s[:250])
    with pytest.raises(InputError, match=r"duration 0\.1 s"):
        record(0, UAV, duration_s=0.1)


def test_a_recording_that_fails_leaves_nothing(tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise RuntimeError("no more")

    monkeypatch.setattr(recording_module.Renderer, "frame", fail)
    with pytest.raises(RuntimeError):
        write_recording(short(), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
