"""A small rig and markers in front of it, with the projection written out by hand."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.data import Camera, CornerSightings, Rig, Sightings

CORNERS = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
BODY_CAM = Rotation.from_rotvec([0.3, -1.1, 0.7])


def camera(model: str = "equidistant") -> Camera:
    distortion = {
        "none": [],
        "radtan": [-0.28, 0.07, 2e-4, -1.5e-3],
        "radtan5": [-0.28, 0.09, 2e-4, -1.5e-3, -0.01],
        "equidistant": [-0.0122741, -0.0100319, 0.00752173, -0.00247881],
    }[model]
    return Camera(
        intrinsics_px=np.array([603.9, 601.2, 665.0, 554.3]),
        distortion_model=model.removesuffix("5"),
        distortion=np.array(distortion, dtype=np.float64),
        resolution_px=(1280, 1024),
        t_body_cam_m=np.array([0.1, -0.2, 0.05]),
        quat_body_cam_wxyz=BODY_CAM.as_quat(scalar_first=True),
    )


def rig(model: str = "equidistant") -> Rig:
    return Rig(cameras={"left": camera(model)})


def pixels_of(points: np.ndarray, camera: Camera) -> np.ndarray:
    """The textbook formulas, not OpenCV's code."""
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    r = np.hypot(x, y)
    if camera.distortion_model == "equidistant":
        a = np.arctan(r)
        distorted = a * (1.0 + sum(k * a ** (2 * i + 2) for i, k in enumerate(camera.distortion)))
        factor = np.where(r > 1e-12, distorted / np.where(r > 1e-12, r, 1.0), 1.0)
        x, y = factor * x, factor * y
    elif camera.distortion_model == "radtan":
        k1, k2, p1, p2, *k3 = camera.distortion
        radial = 1.0 + k1 * r**2 + k2 * r**4 + (k3[0] if k3 else 0.0) * r**6
        dx = 2.0 * p1 * x * y + p2 * (r**2 + 2.0 * x**2)
        dy = p1 * (r**2 + 2.0 * y**2) + 2.0 * p2 * x * y
        x, y = radial * x + dx, radial * y + dy
    fx, fy, cx, cy = camera.intrinsics_px
    return np.stack([fx * x + cx, fy * y + cy], axis=-1)


def corners_of(R_cam_marker: np.ndarray, t_cam_marker: np.ndarray, side_m: float, camera: Camera) -> np.ndarray:
    """(n, 4, 2) pixels of markers at the given camera-frame poses."""
    points = side_m * CORNERS @ np.swapaxes(R_cam_marker, -1, -2) + t_cam_marker[..., None, :]
    return pixels_of(points, camera)


def corner_sightings(corners_px: np.ndarray, marker: str = "7", camera: str = "left") -> CornerSightings:
    n = len(corners_px)
    return CornerSightings(
        stamp_s=np.arange(n, dtype=np.float64),
        camera=np.array([camera] * n),
        marker=np.array([marker] * n),
        corners_px=corners_px,
        source=np.array([f"tags.csv:{i + 2}" for i in range(n)]),
    )


def facing(tilt_rad: float, about_rad: float = 0.4) -> np.ndarray:
    """A marker that faces the camera, tilted by `tilt_rad`."""
    axis = np.array([np.cos(about_rad), np.sin(about_rad), 0.0])
    return (Rotation.from_rotvec(tilt_rad * axis) * Rotation.from_rotvec([np.pi, 0.0, 0.0])).as_matrix()


def point_sightings(
    stamp_s: np.ndarray, t_body_marker_m: np.ndarray, sigma_m: float | np.ndarray = 0.01, marker: object = "A"
) -> Sightings:
    """Sightings without rotation, isotropic covariance."""
    n = len(stamp_s)
    covariance = np.zeros((n, 6, 6))
    covariance[:, :3, :3] = (np.broadcast_to(sigma_m, (n,)) ** 2)[:, None, None] * np.eye(3)
    return Sightings(
        stamp_s=np.asarray(stamp_s, dtype=np.float64),
        marker=np.broadcast_to(np.asarray(marker, dtype=str), (n,)).copy(),
        t_body_marker_m=np.asarray(t_body_marker_m, dtype=np.float64),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=covariance,
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"sightings.csv:{i + 2}" for i in range(n)]),
    )
