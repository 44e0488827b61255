from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from data_root import data_root
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from jaxgeo.errors import SightingError
from jaxgeo.io import InputWarning, read_rig

CAMERA = {
    "model": "pinhole",
    "intrinsics_px": [603.924, 603.166, 665.041, 554.34],
    "distortion_model": "equidistant",
    "distortion": [-0.0122741, -0.0100319, 0.00752173, -0.00247881],
    "resolution_px": [1280, 1024],
    "t_body_cam_m": [0.1, 0.2, 0.3],
    "rotvec_body_cam_rad": [0.1, -0.2, 0.3],
}
OPTICS = {key: CAMERA[key] for key in ("intrinsics_px", "distortion_model", "distortion")}
TEXT = """
cameras:
  cam0:
    model: pinhole
    intrinsics_px: [603.924, 603.166, 665.041, 554.34]
    distortion_model: radtan
    distortion: [-1e-2, 1e-3, 0, .5e-4]
    t_body_cam_m: [0, 0, 0]
    quat_body_cam_wxyz: [1, 0, 0, 0]
"""


def rig(**change: Any) -> dict[str, Any]:
    camera = {**CAMERA, **change}
    return {"cameras": {"cam0": {key: value for key, value in camera.items() if value != "absent"}}}


def test_a_file_reads_as_its_content(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(rig()))
    for camera in (read_rig(path).cameras["cam0"], read_rig(rig()).cameras["cam0"]):
        assert camera.intrinsics_px.tolist() == CAMERA["intrinsics_px"]
        assert camera.distortion.tolist() == CAMERA["distortion"]
        assert camera.distortion_model == "equidistant"
        assert camera.resolution_px == (1280, 1024)
        assert camera.t_body_cam_m.tolist() == [0.1, 0.2, 0.3]


def test_numbers_without_a_point_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(TEXT)
    assert read_rig(path).cameras["cam0"].distortion.tolist() == [-1e-2, 1e-3, 0, 5e-5]


@settings(deadline=None)
@given(rotvec=hnp.arrays(float, 3, elements=st.floats(-1.5, 1.5)))
def test_three_ways_to_write_a_rotation(rotvec: np.ndarray) -> None:
    rotation = Rotation.from_rotvec(rotvec)
    forms = {
        "rotvec_body_cam_rad": rotvec.tolist(),
        "quat_body_cam_wxyz": rotation.as_quat(scalar_first=True).tolist(),
        "R_body_cam": rotation.as_matrix().tolist(),
    }
    for key, value in forms.items():
        camera = read_rig(rig(**{"rotvec_body_cam_rad": "absent", key: value})).cameras["cam0"]
        read = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True)
        np.testing.assert_allclose(read.as_matrix(), rotation.as_matrix(), atol=1e-14)


@settings(deadline=None)
@given(numbers=hnp.arrays(float, (4, 3), elements=st.floats(-1.5, 1.5)))
def test_cameras_of_a_rig_frame_move_to_the_body(numbers: np.ndarray) -> None:
    t_cam, r_cam, t_body, r_body = numbers

    def matrix(t_m: np.ndarray, rotvec: np.ndarray) -> np.ndarray:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), t_m
        return T

    content = {
        "T_rig_body": {"t_m": t_body.tolist(), "rotvec_rad": r_body.tolist()},
        "cameras": {"cam0": {**OPTICS, "T_rig_cam": {"t_m": t_cam.tolist(), "rotvec_rad": r_cam.tolist()}}},
    }
    camera = read_rig(content).cameras["cam0"]
    expected = np.linalg.inv(matrix(t_body, r_body)) @ matrix(t_cam, r_cam)
    np.testing.assert_allclose(camera.t_body_cam_m, expected[:3, 3], atol=1e-13)
    rotation = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(rotation, expected[:3, :3], atol=1e-13)


def test_the_real_stereo_rig() -> None:
    folder = data_root() / "tagslam/test_11"
    optics = yaml.safe_load((folder / "cameras.yaml").read_text())
    poses = yaml.safe_load((folder / "camera_poses.yaml").read_text())
    cameras = {
        name: {
            "intrinsics_px": camera["intrinsics"],
            "distortion_model": camera["distortion_model"],
            "distortion": camera["distortion_coeffs"],
            "resolution_px": camera["resolution"],
            "T_rig_cam": {
                "t_m": [poses[name]["pose"]["position"][axis] for axis in "xyz"],
                "rotvec_rad": [poses[name]["pose"]["rotation"][axis] for axis in "xyz"],
            },
        }
        for name, camera in optics.items()
    }
    T_rig_body = {
        "t_m": [0.02535438, 0.02040908, -0.02218717],
        "rotvec_rad": [-1.50468965e-2, -1.17231429e-3, -3.13883257],
    }
    read = read_rig({"cameras": cameras, "T_rig_body": T_rig_body}).cameras
    baseline_m = np.linalg.norm(read["cam1"].t_body_cam_m - read["cam0"].t_body_cam_m)
    np.testing.assert_allclose(baseline_m, np.linalg.norm([0.20031766, 0.00166686, 0.00093769]), rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"focal": 3}, "rig: cam0: unknown key 'focal'; expected some of model, intrinsics_px"),
        ({"model": "omni"}, "rig: cam0: model: 'omni'; expected pinhole"),
        ({"intrinsics_px": "absent"}, r"rig: cam0: intrinsics_px is missing; expected \[fx, fy, cx, cy\]"),
        ({"intrinsics_px": [600, 600, 300]}, r"rig: cam0: intrinsics_px: \[600, 600, 300\]; expected \[fx, fy"),
        ({"intrinsics_px": [600, "f", 300, 1]}, r"rig: cam0: intrinsics_px: .*expected \[fx, fy"),
        ({"intrinsics_px": [-600, 600, 300, 300]}, r"focal lengths \[-600\.0, 600\.0\]; expected positive"),
        ({"intrinsics_px": [600, 600, 3000, 300]}, r"principal point \[3000\.0, 300\.0\] lies outside the image"),
        ({"distortion_model": "fisheye"}, "distortion_model: 'fisheye'; expected one of radtan, equidistant, none"),
        ({"distortion_model": "absent"}, "distortion_model: None; expected one of radtan"),
        ({"distortion": [1, 2, 3]}, "distortion: 3 coefficients; equidistant expects 4"),
        ({"distortion_model": "radtan", "distortion": [0.1]}, "distortion: 1 coefficients; radtan expects 4 or 5"),
        ({"distortion_model": "none"}, "distortion: 4 coefficients; none expects 0"),
        ({"distortion": 0.1}, "distortion: 0.1; equidistant expects 4"),
        (
            {"resolution_px": [1280.5, 1024]},
            r"resolution_px: \[1280\.5, 1024\.0\]; expected \[width, height\] in whole",
        ),
        ({"t_body_cam_m": "absent"}, r"t_body_cam_m is missing; expected \[x, y, z\] in metres"),
        ({"t_body_cam_m": [0, 0, float("nan")]}, r"t_body_cam_m: .* expected \[x, y, z\] in metres, finite"),
        (
            {"rotvec_body_cam_rad": "absent"},
            "no rotation; expected exactly one of rotvec_body_cam_rad, quat_body_cam_wxyz",
        ),
        ({"quat_body_cam_wxyz": [1, 0, 0, 0]}, "rotvec_body_cam_rad, quat_body_cam_wxyz; expected exactly one of"),
        ({"rotvec_body_cam_rad": "absent", "quat_body_cam_wxyz": [1, 1, 0, 0]}, "quat_body_cam_wxyz has norm 1.41421"),
        (
            {"rotvec_body_cam_rad": "absent", "R_body_cam": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]},
            "R_body_cam is not a rotation: .* the determinant is -1",
        ),
        ({"T_rig_cam": {}}, "T_rig_cam and rotvec_body_cam_rad; expected one of the two"),
    ],
)
def test_bad_cameras(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SightingError, match=message):
        read_rig(rig(**change))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"cameras": {}}, r"rig: cameras: \{\}; expected at least one camera"),
        ({"camera": {}}, "rig: unknown key 'camera'; expected some of cameras, T_rig_body"),
        ({"cameras": {"cam0": 3}}, "rig: cam0: 3; expected a mapping of model"),
        ({"cameras": {"cam0": {**OPTICS, "T_rig_cam": {"t_m": [0] * 3, "rotvec_rad": [0] * 3}}}}, "but no T_rig_body"),
        ({**rig(), "T_rig_body": {"t_m": [0] * 3, "rotvec_rad": [0] * 3}}, "but no camera has T_rig_cam"),
        ({**rig(), "T_rig_body": {"t_m": [0] * 3}}, "rig: T_rig_body: rotvec_rad is missing"),
        ({**rig(), "T_rig_body": [0] * 6}, r"rig: T_rig_body: \[0, 0.*expected \{t_m: \[x, y, z\]"),
    ],
)
def test_bad_rigs(content: dict[str, Any], message: str) -> None:
    with pytest.raises(SightingError, match=message):
        read_rig(content)


def test_a_principal_point_just_outside_is_told() -> None:
    with pytest.warns(InputWarning, match=r"principal point \[1300\.0, 300\.0\] lies outside the image"):
        read_rig(rig(intrinsics_px=[600, 600, 1300, 300]))
