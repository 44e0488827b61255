"""Rigs: cameras with their intrinsics, and their poses on the body.

    cameras:
      cam0:
        model: pinhole
        intrinsics_px: [fx, fy, cx, cy]
        distortion_model: equidistant        # or radtan, none
        distortion: [k1, k2, k3, k4]
        resolution_px: [width, height]       # may be left out
        t_body_cam_m: [x, y, z]
        rotvec_body_cam_rad: [x, y, z]       # or quat_body_cam_wxyz, or R_body_cam

Where the cameras are known in a rig frame instead, each has `T_rig_cam: {t_m, rotvec_rad}`, and the body's pose in that
frame stands beside `cameras`: `T_rig_body: {t_m, rotvec_rad}`.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Camera, Rig
from jaxgeo.errors import SightingError
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.io.yaml_file import read_yaml

DISTORTION_COUNTS = {"radtan": (4, 5), "equidistant": (4,), "none": (0,)}
ROTATION_TOLERANCE = 1e-4
_LARGEST = 1e8  # of anything in pixels, metres or radians
_ROTATIONS = ("rotvec_body_cam_rad", "quat_body_cam_wxyz", "R_body_cam")
_OPTICS = ("model", "intrinsics_px", "distortion_model", "distortion", "resolution_px")
_CAMERA_KEYS = (*_OPTICS, "t_body_cam_m", *_ROTATIONS, "T_rig_cam")

Pose = tuple[Float[np.ndarray, "3"], Rotation]
"""Translation in metres, and rotation."""


def read_rig(source: str | Path | Mapping[str, Any]) -> Rig:
    """Read a rig from a YAML file, or from a mapping of the same form.

    Raises:
        SightingError: naming file, camera and key: unknown or missing keys, wrong counts, values out of range.
    """
    inline = isinstance(source, Mapping)
    place = "rig" if inline else str(source)
    content = source if inline else read_yaml(source, SightingError)
    _check_keys(place, content, ("cameras", "T_rig_body"))
    cameras = content.get("cameras")
    if not isinstance(cameras, Mapping) or not cameras:
        raise SightingError(f"{place}: cameras: {cameras!r}; expected at least one camera: {{cam0: {{...}}}}.")
    T_rig_body = _pose(f"{place}: T_rig_body", content["T_rig_body"]) if "T_rig_body" in content else None
    rig = Rig({str(name): _camera(f"{place}: {name}", camera, T_rig_body) for name, camera in cameras.items()})
    if T_rig_body is not None and not any("T_rig_cam" in camera for camera in cameras.values()):
        raise SightingError(f"{place}: T_rig_body is given, but no camera has T_rig_cam. Remove it, or give T_rig_cam.")
    return rig


def _camera(place: str, camera: Any, T_rig_body: Pose | None) -> Camera:
    if not isinstance(camera, Mapping):
        raise SightingError(f"{place}: {camera!r}; expected a mapping of {', '.join(_CAMERA_KEYS)}.")
    _check_keys(place, camera, _CAMERA_KEYS)
    if camera.get("model", "pinhole") != "pinhole":
        raise SightingError(f"{place}: model: {camera['model']!r}; expected pinhole.")
    intrinsics_px = _numbers(place, camera, "intrinsics_px", (4,), "[fx, fy, cx, cy] in pixels")
    if not (intrinsics_px[:2] > 0).all():
        raise SightingError(f"{place}: focal lengths {intrinsics_px[:2].tolist()}; expected positive pixels.")
    distortion_model, distortion = _distortion(place, camera)
    t_body_cam_m, rotation = _camera_pose(place, camera, T_rig_body)
    return Camera(
        intrinsics_px=intrinsics_px,
        distortion_model=distortion_model,
        distortion=distortion,
        resolution_px=_resolution(place, camera, intrinsics_px),
        t_body_cam_m=t_body_cam_m,
        quat_body_cam_wxyz=rotation.as_quat(scalar_first=True),
    )


def _distortion(place: str, camera: Mapping[str, Any]) -> tuple[str, Float[np.ndarray, "k"]]:
    model = camera.get("distortion_model")
    if not isinstance(model, str) or model not in DISTORTION_COUNTS:
        raise SightingError(f"{place}: distortion_model: {model!r}; expected one of {', '.join(DISTORTION_COUNTS)}.")
    given = camera.get("distortion") or []
    counts = DISTORTION_COUNTS[model]
    if not isinstance(given, list | tuple) or len(given) not in counts:
        count = f"{len(given)} coefficients" if isinstance(given, list | tuple) else repr(given)
        expected = " or ".join(map(str, counts))
        raise SightingError(f"{place}: distortion: {count}; {model} expects {expected} (radtan: k1, k2, p1, p2[, k3]).")
    return model, _numbers(place, {"distortion": list(given)}, "distortion", (len(given),), "numbers")


def _resolution(place: str, camera: Mapping[str, Any], intrinsics_px: Float[np.ndarray, "4"]) -> tuple[int, int] | None:
    if camera.get("resolution_px") is None:
        return None
    size = _numbers(place, camera, "resolution_px", (2,), "[width, height] in whole pixels")
    if not ((size > 0) & (size == np.round(size))).all():
        raise SightingError(f"{place}: resolution_px: {size.tolist()}; expected [width, height] in whole pixels.")
    beyond = np.max(np.abs(intrinsics_px[2:] / size - 0.5)) - 0.5  # in image sizes, beyond the image's edge
    message = (
        f"{place}: the principal point {intrinsics_px[2:].tolist()} lies outside the image of {size.tolist()} px. "
        "Are the intrinsics [fx, fy, cx, cy], and of this resolution [width, height]?"
    )
    if beyond > 0.5:
        raise SightingError(message)
    if beyond > 0:
        warnings.warn(message, InputWarning, stacklevel=4)
    return int(size[0]), int(size[1])


def _camera_pose(place: str, camera: Mapping[str, Any], T_rig_body: Pose | None) -> Pose:
    rotations = [key for key in _ROTATIONS if key in camera]
    if "T_rig_cam" in camera:
        if rotations or "t_body_cam_m" in camera:
            raise SightingError(f"{place}: T_rig_cam and {(*rotations, 't_body_cam_m')[0]}; expected one of the two.")
        if T_rig_body is None:
            raise SightingError(
                f"{place}: T_rig_cam, but no T_rig_body beside `cameras`: the camera's place on the body is not "
                "known. Add T_rig_body: {t_m: .., rotvec_rad: ..} (zeros where the rig frame is the body frame)."
            )
        t_rig_cam, R_rig_cam = _pose(f"{place}: T_rig_cam", camera["T_rig_cam"])
        t_rig_body, R_rig_body = T_rig_body
        return R_rig_body.inv().apply(t_rig_cam - t_rig_body), R_rig_body.inv() * R_rig_cam
    if len(rotations) != 1:
        given = ", ".join(rotations) or "no rotation"
        raise SightingError(f"{place}: {given}; expected exactly one of {', '.join(_ROTATIONS)} (or T_rig_cam).")
    return _numbers(place, camera, "t_body_cam_m", (3,), "[x, y, z] in metres"), _rotation(place, camera, rotations[0])


def _rotation(place: str, camera: Mapping[str, Any], key: str) -> Rotation:
    if key == "rotvec_body_cam_rad":
        return Rotation.from_rotvec(_numbers(place, camera, key, (3,), "a rotation vector in radians"))
    if key == "quat_body_cam_wxyz":
        quat_wxyz = _numbers(place, camera, key, (4,), "a unit quaternion, w first")
        norm = np.linalg.norm(quat_wxyz)
        if abs(norm - 1) > ROTATION_TOLERANCE:
            raise SightingError(f"{place}: {key} has norm {norm:.6g}, expected 1 within {ROTATION_TOLERANCE:g}.")
        return Rotation.from_quat(quat_wxyz, scalar_first=True)
    matrix = _numbers(place, camera, key, (3, 3), "a rotation matrix, three rows of three")
    off = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if off > ROTATION_TOLERANCE or np.linalg.det(matrix) < 0:
        raise SightingError(
            f"{place}: {key} is not a rotation: R R^T is off the identity by {off:.3g} and the determinant is "
            f"{np.linalg.det(matrix):.4g}, expected orthonormal rows and determinant 1."
        )
    return Rotation.from_matrix(matrix)


def _pose(place: str, pose: Any) -> Pose:
    if not isinstance(pose, Mapping):
        raise SightingError(f"{place}: {pose!r}; expected {{t_m: [x, y, z], rotvec_rad: [x, y, z]}}.")
    _check_keys(place, pose, ("t_m", "rotvec_rad"))
    rotvec_rad = _numbers(place, pose, "rotvec_rad", (3,), "a rotation vector in radians")
    return _numbers(place, pose, "t_m", (3,), "[x, y, z] in metres"), Rotation.from_rotvec(rotvec_rad)


def _numbers(
    place: str, mapping: Mapping[str, Any], key: str, shape: tuple[int, ...], expected: str
) -> Float[np.ndarray, "..."]:
    if key not in mapping:
        raise SightingError(f"{place}: {key} is missing; expected {expected}.")
    try:
        values = np.array(mapping[key], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SightingError(f"{place}: {key}: {mapping[key]!r:.200}; expected {expected}.") from None
    if values.shape != shape or not (np.abs(values) <= _LARGEST).all():
        raise SightingError(
            f"{place}: {key}: {mapping[key]!r:.200}; expected {expected}, finite, at most {_LARGEST:g}."
        )
    return values


def _check_keys(place: str, mapping: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in mapping:
        if key not in known:
            raise SightingError(f"{place}: unknown key {key!r}; expected some of {', '.join(known)}.")
