"""Cameras as RTAB-Map stores them with each node.

Since version 0.18, each camera is eleven int32 (three of the version, type 0, width, height, and the counts of what
follows) and then, in float64, K (9), D (4, 5, 6 or 8), R (9), P (12), and in float32 the local transform (12). A stereo
camera is ten int32 (three of the version, type 1, counts of R, T, E and F, bytes of the left and of the right camera),
R, T, E, F in float64, and the two cameras. Before 0.18 each camera is 18 float32: fx fy cx cy width height and the
local transform; a stereo camera 19, with the baseline after cy.

The local transform is `T_body_cam` of the optical axes (x right, y down, z forward), the form of `Camera`. Where P is
there, RTAB-Map takes the stored images as rectified: P holds their intrinsics, and they have no distortion.
"""

import dataclasses
import struct

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Camera, Rig
from jaxgeo.errors import ScanError
from jaxgeo.io.pose_matrices import check_poses, pose_parts
from jaxgeo.io.rtabmap.blobs import numbers

_MONO = struct.Struct("<11i")
_STEREO = struct.Struct("<10i")
_COUNTS = {"K": (9,), "D": (0, 4, 5, 6, 8, 12, 14), "R": (0, 9), "P": (0, 12), "local transform": (0, 12)}
_LARGEST_SIDE = 1 << 20


@dataclasses.dataclass(frozen=True)
class StoredCamera:
    """One camera as it stands in the database.

    Attributes:
        size: (width, height); zeros where unknown.
        K: (3, 3); of the raw images.
        D: (k,) distortion of the raw images: 4, 5, 8, 12 or 14 of OpenCV's, or 6: k1 k2 0 0 k3 k4 of a fisheye.
        P: (3, 4) of the rectified images; None where there is none.
        T_body_cam: (3, 4), optical axes.
        right: the right camera of a stereo pair: its image is stored in the place of depth.
    """

    size: tuple[int, int]
    K: Float[np.ndarray, "3 3"]
    D: Float[np.ndarray, "k"]
    P: Float[np.ndarray, "3 4"] | None
    T_body_cam: Float[np.ndarray, "3 4"]
    right: bool = False


def stored_cameras(data: bytes, version: tuple[int, ...], place: str) -> list[StoredCamera]:
    """The cameras of one node; of a stereo camera the left one and the right one.

    Raises:
        ScanError: cut off, counts that there are not, or values that are no camera.
    """
    found = _old_cameras(data, place) if version < (0, 18) else _cameras(data, place)
    for i, camera in enumerate(found):
        _check(camera, f"{place}: camera {i}")
    return found


def rig_of(stored: list[StoredCamera], rectified: bool, path: str) -> Rig | None:
    """The cameras `cam0`, `cam1`, ... that took the stored images; None where there are none.

    Args:
        stored: as in the database.
        rectified: the images are.
        path: the database, for messages.

    Raises:
        ScanError: as `camera_of`.
    """
    cameras = {f"cam{i}": camera_of(c, rectified, f"{path}: calibration: cam{i}") for i, c in enumerate(stored)}
    return Rig(cameras) if cameras else None


def camera_of(stored: StoredCamera, rectified: bool, place: str) -> Camera:
    """The camera that took the stored images.

    Args:
        stored: as in the database.
        rectified: the images are: P holds where it is there.
        place: for messages.

    Raises:
        ScanError: a distortion that `Camera` has no name for.
    """
    t_m, quat_wxyz = pose_parts(stored.T_body_cam[None])
    if rectified and stored.P is not None:
        matrix, model, distortion = stored.P, "none", np.empty(0)
    else:
        matrix = stored.K
        model, distortion = _distortion(stored.D, place)
    return Camera(
        intrinsics_px=np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]),
        distortion_model=model,
        distortion=distortion,
        resolution_px=stored.size if all(stored.size) else None,
        t_body_cam_m=t_m[0],
        quat_body_cam_wxyz=quat_wxyz[0],
    )


def _distortion(D: Float[np.ndarray, "k"], place: str) -> tuple[str, Float[np.ndarray, "m"]]:
    if not D.any():
        return "none", np.empty(0)
    if len(D) == 6:
        return "equidistant", D[[0, 1, 4, 5]]
    if D[5:].any():
        raise ScanError(
            f"{place}: {len(D)} distortion coefficients {D.tolist()}, the rational model, which is not supported; "
            "expected radtan (5) or equidistant (6). Rectify the images in RTAB-Map (rtabmap-reprocess)."
        )
    return "radtan", D[:5]


def _cameras(data: bytes, place: str) -> list[StoredCamera]:
    found: list[StoredCamera] = []
    at = 0
    while at < len(data):
        if len(data) - at < _STEREO.size:
            raise ScanError(f"{place}: ends within the head of a camera, at byte {len(data)}. Is the value cut off?")
        kind = struct.unpack_from("<i", data, at + 12)[0]
        if kind == 0:
            camera, at = _mono(data, at, place)
            found.append(camera)
        elif kind == 1:
            pair, at = _stereo(data, at, place)
            found += pair
        else:
            raise ScanError(f"{place}: a camera of type {kind}; expected 0 (one camera) or 1 (stereo).")
    return found


def _mono(data: bytes, at: int, place: str) -> tuple[StoredCamera, int]:
    if len(data) - at < _MONO.size:
        raise ScanError(f"{place}: ends within the head of a camera, at byte {len(data)}. Is the value cut off?")
    _, _, _, kind, width, height, *counts = _MONO.unpack_from(data, at)
    if kind != 0:
        raise ScanError(f"{place}: a camera of type {kind} where one camera (type 0) is expected.")
    for (name, known), count in zip(_COUNTS.items(), counts, strict=True):
        if count not in known:
            raise ScanError(f"{place}: {count} numbers of {name}; expected {' or '.join(map(str, known))}.")
    at += _MONO.size
    parts: list[np.ndarray] = []
    for count, dtype in zip(counts, ["<f8"] * 4 + ["<f4"], strict=True):
        size = count * np.dtype(dtype).itemsize
        if len(data) - at < size:
            raise ScanError(f"{place}: ends within a camera, at byte {len(data)}. Is the value cut off?")
        parts.append(numbers(data[at : at + size], dtype, count, place))
        at += size
    K, D, _, P, local = parts
    pose = local.reshape(3, 4) if len(local) else np.zeros((3, 4))
    return StoredCamera((width, height), K.reshape(3, 3), D, P.reshape(3, 4) if len(P) else None, pose), at


def _stereo(data: bytes, at: int, place: str) -> tuple[list[StoredCamera], int]:
    _, _, _, _, *counts, left_bytes, right_bytes = _STEREO.unpack_from(data, at)
    for name, count, known in zip("RTEF", counts, ((0, 9), (0, 3), (0, 9), (0, 9)), strict=True):
        if count not in known:
            raise ScanError(f"{place}: {count} numbers of the stereo {name}; expected {' or '.join(map(str, known))}.")
    start = at + _STEREO.size + 8 * sum(counts)
    left, at = _mono(data, start, place)  # refuses what ends before it
    extrinsics = np.frombuffer(data, "<f8", counts[0] + counts[1], start - 8 * sum(counts))
    right, end = _mono(data, at, place)
    if (at - start, end - at) != (left_bytes, right_bytes):
        raise ScanError(
            f"{place}: the stereo camera announces {left_bytes} + {right_bytes} bytes and holds {at - start} + "
            f"{end - at}. Is the value damaged?"
        )
    if left.P is not None and right.P is not None and right.P[0, 0] > 0:
        with np.errstate(over="ignore", invalid="ignore"):
            baseline_m = -right.P[0, 3] / right.P[0, 0]
        right = _beside(left, right, baseline_m)
    elif len(extrinsics) == 12:
        R, T = extrinsics[:9].reshape(3, 3), extrinsics[9:]  # x_right = R x_left + T
        with np.errstate(over="ignore", invalid="ignore"):  # beyond float64: refused as not finite
            R_body_cam = left.T_body_cam[:, :3] @ R.T
            t_body_cam = left.T_body_cam[:, 3] - R_body_cam @ T
        right = dataclasses.replace(right, T_body_cam=np.column_stack([R_body_cam, t_body_cam]), right=True)
    else:
        raise ScanError(
            f"{place}: a stereo camera with neither projection matrices nor R and T: its baseline is not known."
        )
    return [left, right], end


def _old_cameras(data: bytes, place: str) -> list[StoredCamera]:
    if len(data) % 72 == 0 and data:
        rows = numbers(data, "<f4", len(data) // 4, place).reshape(-1, 18)
        return [_pinhole(row[:4], row[4:6], row[6:], place) for row in rows]
    if len(data) == 76:
        row = numbers(data, "<f4", 19, place)
        left = _pinhole(row[:4], row[5:7], row[7:], place)
        return [left, _beside(left, left, float(row[4]))]
    raise ScanError(
        f"{place}: {len(data)} bytes, expected 72 for each camera, or 76 of a stereo camera. Is it cut off?"
    )


def _pinhole(
    fx_fy_cx_cy: Float[np.ndarray, "4"], size: Float[np.ndarray, "2"], local: Float[np.ndarray, "12"], place: str
) -> StoredCamera:
    if not (np.isfinite(size) & (size >= 0) & (size < _LARGEST_SIDE)).all():
        raise ScanError(f"{place}: an image size of {size.tolist()}; expected whole pixels. Is the value damaged?")
    fx, fy, cx, cy = fx_fy_cx_cy
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return StoredCamera((int(size[0]), int(size[1])), K, np.empty(0), None, local.reshape(3, 4))


def _beside(left: StoredCamera, right: StoredCamera, baseline_m: float) -> StoredCamera:
    """The right camera of a rectified pair: parallel to the left one, by the baseline along its x axis."""
    pose = left.T_body_cam.copy()
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float64: refused as not finite
        pose[:, 3] += pose[:, 0] * baseline_m
    return dataclasses.replace(right, T_body_cam=pose, right=True)


def _check(camera: StoredCamera, place: str) -> None:
    width, height = camera.size
    if not (0 <= width < _LARGEST_SIDE and 0 <= height < _LARGEST_SIDE):
        raise ScanError(f"{place}: an image size of {width} x {height}; expected whole pixels. Is the value damaged?")
    for matrix in (camera.K, camera.D, *([] if camera.P is None else [camera.P])):
        if not np.isfinite(matrix).all():
            raise ScanError(f"{place}: holds numbers that are not finite. Is the value damaged?")
    for name, matrix in (("K", camera.K), ("P", camera.P)):
        if matrix is not None and not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise ScanError(
                f"{place}: focal lengths {matrix[0, 0]:g}, {matrix[1, 1]:g} in {name}; expected positive pixels."
            )
    if not camera.T_body_cam.any():
        raise ScanError(f"{place}: no local transform: where the camera sits on the body is not known.")
    check_poses(camera.T_body_cam[None], lambda _: f"{place}: local transform", ScanError)
