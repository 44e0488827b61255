"""`jaxgeo rtabmap`: the files that it writes read back through the readers that they are meant for."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from data_root import data_root
from rtabmap_database import OPTICAL, SmallDatabase, camera_blob, compressed, encoded, projection, rvl, scan_info_blob
from typer.testing import CliRunner

from jaxgeo.cli.rtabmap import import_rtabmap, stamp_name
from jaxgeo.cli.rtabmap_command import rtabmap
from jaxgeo.data import Camera, Rig
from jaxgeo.errors import InputError
from jaxgeo.io import read_rig, read_tum
from jaxgeo.io.frames.stamps import stamp_in_name
from jaxgeo.io.rgbd.source import open_rgbd
from jaxgeo.io.rig_text import rig_yaml
from jaxgeo.io.scans.source import open_scans

STAMPS = [1702296897.4249847, 1702296898.1, 1702296899.25]
DEPTH = (np.arange(48, dtype=np.uint16).reshape(6, 8) + 1) * 100


def picture(value: int) -> np.ndarray:
    return np.full((6, 8, 3), [value, 10, 200], np.uint8)


def pose(x: float) -> np.ndarray:
    return np.column_stack([np.eye(3), [x, 0.0, 0.0]])


def decoded(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


def small(path: Path) -> Path:
    rows = np.array([[1, 2, 3, 50], [4, 5, 6, 60]], "<f4")
    with SmallDatabase(path) as made:
        for node, stamp in enumerate(STAMPS, start=1):
            made.node(node, pose(node), stamp=stamp)
        made.link(1, 2, 0, pose(1.0))
        made.link(2, 3, 0, pose(1.0))
        made.link(3, 1, 1, pose(-2.0))
        made.link(1, -1, 8)
        made.optimised([1, 2, 3], np.array([pose(10 + x) for x in range(3)]))
        camera = camera_blob(P=projection(20.0), D=[0.1, 0, 0, 0])
        made.data(1, image=encoded(picture(1), ".jpg"), depth=encoded(DEPTH), calibration=camera)
        made.data(2, image=encoded(picture(2)), depth=rvl(DEPTH), calibration=camera)
        made.data(3, image=b"damaged", scan=compressed(rows, 4), scan_info=scan_info_blob(6, OPTICAL))
    return path


def test_everything_reads_back(tmp_path: Path) -> None:
    path, out = small(tmp_path / "map.db"), tmp_path / "out"
    result = CliRunner().invoke(_app(), [str(path), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "nodes 3 (3 optimised), sessions 1, links 3" in result.output
    assert "images: 2 color, 2 depth" in result.output
    assert "warning: 1 images left out; the first: " in result.output
    assert "node 3: image: 7 bytes" in result.output

    odometry, optimised = read_tum(out / "odometry.tum"), read_tum(out / "optimised.tum")
    assert odometry.stamp_s.tolist() == optimised.stamp_s.tolist() == STAMPS
    np.testing.assert_allclose(optimised.position_m[:, 0], [10, 11, 12])
    assert not (out / "truth.tum").exists()

    camera = read_rig(out / "rig.yaml").cameras["cam0"]
    assert camera.intrinsics_px.tolist() == [20, 20, 4.5, 3.5]
    assert camera.resolution_px == (8, 6)
    np.testing.assert_allclose(camera.t_body_cam_m, OPTICAL[:, 3], atol=1e-7)

    names = [path.name for path in sorted((out / "color").iterdir())]
    assert names == ["1702296897.4249847.jpg", "1702296898.1.png"]
    assert (out / "color" / names[0]).read_bytes() == encoded(picture(1), ".jpg")  # as stored, not coded again
    for name in names:
        depth = out / "depth" / Path(name).with_suffix(".png").name
        np.testing.assert_array_equal(decoded(depth), DEPTH)

    frames = list(open_rgbd(out))
    assert [frame.stamp_s for frame in frames] == STAMPS[:2]
    np.testing.assert_array_equal(frames[1].image, picture(2))
    np.testing.assert_allclose(frames[1].depth_m, DEPTH / 1000, rtol=1e-6)

    (scan,) = open_scans(out / "scans")
    assert scan.stamp_s == STAMPS[2]
    expected = np.array([[1, 2, 3], [4, 5, 6]]) @ OPTICAL[:, :3].T + OPTICAL[:, 3]
    np.testing.assert_allclose(scan.points_m, expected, atol=1e-6)
    assert scan.intensity is not None
    assert scan.intensity.tolist() == [50, 60]

    record = json.loads((out / "rtabmap.json").read_text())
    assert record["version"] == "0.21.1"
    assert record["images"] == {"color": 2, "depth": 2}
    assert record["graph"]["links"] == {"neighbour": 2, "global_closure": 1}
    assert record["left_out"]["landmark links"]["count"] == 1
    assert record["cameras"]["stored"][0]["D"] == [0.1, 0, 0, 0]
    assert record["cameras"]["images_are_rectified"] is True


def test_without_images_and_scans(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import_rtabmap(small(tmp_path / "map.db"), tmp_path / "out", images=False, scans=False, quiet=True)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "graph.g2o",
        "odometry.tum",
        "optimised.tum",
        "rig.yaml",
        "rtabmap.json",
    ]
    assert capsys.readouterr() == ("", "")


def test_sessions_get_files_of_their_own(tmp_path: Path) -> None:
    with SmallDatabase(tmp_path / "map.db") as made:
        for node in (1, 2, 3, 4):
            made.node(node, pose(node), map_id=node // 3)
    import_rtabmap(tmp_path / "map.db", tmp_path / "out", quiet=True)
    assert len(read_tum(tmp_path / "out/odometry_0.tum")) == 2
    assert len(read_tum(tmp_path / "out/odometry_1.tum")) == 2


def test_two_cameras(tmp_path: Path) -> None:
    with SmallDatabase(tmp_path / "map.db") as made:
        made.node(1, stamp=5.0)
        image, depth = np.hstack([picture(1), picture(2)]), np.hstack([DEPTH, DEPTH + 1])
        made.data(1, image=encoded(image), depth=encoded(depth), calibration=camera_blob() + camera_blob(fx=20))
    import_rtabmap(tmp_path / "map.db", tmp_path / "out", quiet=True)
    for folder, value in (("color", 1), ("cam1/color", 2)):
        np.testing.assert_array_equal(decoded(tmp_path / "out" / folder / "5.0.png"), picture(value))
    np.testing.assert_array_equal(decoded(tmp_path / "out/cam1/depth/5.0.png"), DEPTH + 1)
    assert list(read_rig(tmp_path / "out/rig.yaml").cameras) == ["cam0", "cam1"]


def test_a_calibration_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, data in (("rational", camera_blob(D=[1, 2, 3, 4, 5, 6, 7, 8])), ("damaged", b"damaged")):
        with SmallDatabase(tmp_path / f"{name}.db") as made:
            made.node(1)
            made.data(1, image=encoded(picture(1)), calibration=data)
        import_rtabmap(tmp_path / f"{name}.db", tmp_path / name)
        assert "warning: 1 rigs left out; the first: " in capsys.readouterr().err
        assert sorted(p.name for p in (tmp_path / name).iterdir()) == [
            "color",
            "odometry.tum",
            "rtabmap.json",
        ]


def test_nothing_is_left_behind_by_a_refusal(tmp_path: Path) -> None:
    with SmallDatabase(tmp_path / "map.db") as made:
        made.node(1, stamp=5.0)
        made.node(2, stamp=5.0)
    with pytest.raises(InputError, match="nodes 1 and 2 have the stamp"):
        import_rtabmap(tmp_path / "map.db", tmp_path / "out", quiet=True)
    with pytest.raises(InputError, match="without nodes: nothing was recorded"):
        import_rtabmap(data_root() / "rtabmap/empty_v0.20.18.db", tmp_path / "out", quiet=True)
    assert [p.name for p in tmp_path.iterdir()] == ["map.db"]
    (tmp_path / "out" / "color").mkdir(parents=True)
    with pytest.raises(InputError, match=r"out/color: is there already, and its files would mix"):
        import_rtabmap(small(tmp_path / "good.db"), tmp_path / "out", quiet=True)


@pytest.mark.parametrize("stamp_s", [0.1, 1e-5, 12.0, 1702296897.4249847, 99999999999.0])
def test_stamps_survive_as_names(stamp_s: float) -> None:
    assert stamp_in_name(Path(f"{stamp_name(stamp_s)}.png")) == stamp_s


def test_rigs_survive_as_yaml(tmp_path: Path) -> None:
    quat = np.array([0.5, -0.5, 0.5, -0.5])
    distortion = np.array([0.1, -0.2, 1e-5, 3e-4, 0.5])
    one = Camera(np.array([1 / 3, 2, 3, 4]), "radtan", distortion, None, np.array([0.1, 1e-9, -3]), quat)
    two = Camera(np.array([500, 501, 320, 240.5]), "equidistant", distortion[:4], (640, 480), np.zeros(3), quat)
    (tmp_path / "rig.yaml").write_text(rig_yaml(Rig({"cam0": one, "cam1": two})))
    read = read_rig(tmp_path / "rig.yaml").cameras
    for name, camera in (("cam0", one), ("cam1", two)):
        assert read[name].distortion_model == camera.distortion_model
        assert read[name].resolution_px == camera.resolution_px
        for field in ("intrinsics_px", "distortion", "t_body_cam_m", "quat_body_cam_wxyz"):
            np.testing.assert_array_equal(getattr(read[name], field), getattr(camera, field))


def test_the_real_database(tmp_path: Path) -> None:
    import_rtabmap(data_root() / "rtabmap/henryoon_1node_v0.21.1.db", tmp_path / "out", quiet=True)
    (image,) = (tmp_path / "out/color").iterdir()
    (depth,) = (tmp_path / "out/depth").iterdir()
    assert image.stem == depth.stem == "1702296897.4249847"
    assert decoded(image).shape == (720, 1280, 3)
    stored = decoded(depth)
    assert (stored.shape, stored.dtype) == ((720, 1280), np.uint16)
    assert json.loads((tmp_path / "out/rtabmap.json").read_text())["left_out"] == {}
    assert read_rig(tmp_path / "out/rig.yaml").cameras["cam0"].intrinsics_px[0] == pytest.approx(639.25, abs=0.01)


def _app() -> typer.Typer:
    app = typer.Typer()
    app.command()(rtabmap)
    return app
