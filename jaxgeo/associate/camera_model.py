"""Points and pixels of one camera, for both distortion models, through OpenCV.

Every function also says which of its points the model holds for. A distortion polynomial is a fit over the field of
view: beyond the radius where it turns back, two directions share one pixel and the answer means nothing.
"""

import functools

import cv2
import numpy as np
from jaxtyping import Bool, Float

from jaxgeo.data import Camera
from jaxgeo.errors import SightingError

_COEFFICIENTS = {"none": (0,), "radtan": (4, 5), "equidistant": (4,)}
_ROUND_TRIP_PX = 0.01  # an undistorted point must project back to within this, else the inversion did not converge
_MAX_ANGLE_RAD = np.deg2rad(89.0)  # normalised coordinates end at 90 degrees, and pixel noise explodes before


def check_camera(name: str, camera: Camera) -> None:
    """Refuse a camera whose numbers no formula here can use.

    Raises:
        SightingError: unknown distortion model, wrong number of coefficients, non-finite or non-positive intrinsics.
    """
    if camera.distortion_model not in _COEFFICIENTS:
        raise SightingError(
            f"camera '{name}': distortion model '{camera.distortion_model}' is not known; "
            f"expected one of {', '.join(sorted(_COEFFICIENTS))}."
        )
    expected = _COEFFICIENTS[camera.distortion_model]
    if camera.distortion.size not in expected:
        raise SightingError(
            f"camera '{name}': {camera.distortion.size} distortion coefficients for model "
            f"'{camera.distortion_model}'; expected {' or '.join(map(str, expected))}."
        )
    if not (np.all(np.isfinite(camera.intrinsics_px)) and np.all(np.isfinite(camera.distortion))):
        raise SightingError(f"camera '{name}': intrinsics or distortion are not finite numbers.")
    if np.any(camera.intrinsics_px[:2] <= 0.0):
        raise SightingError(
            f"camera '{name}': focal lengths {camera.intrinsics_px[:2].tolist()} px are not positive; "
            "the order of the intrinsics is fx, fy, cx, cy."
        )


def project(
    points_cam_m: Float[np.ndarray, "n 3"], camera: Camera
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 3"], Bool[np.ndarray, "n"]]:
    """Pixels of points given in the camera's optical axes, with the derivative of each pixel by its point.

    Returns:
        pixels (distorted), d pixel / d point [px/m], and whether the point lies in front of the camera and inside the
        distortion model's range. Pixels of other points are finite but meaningless.
    """
    in_front = points_cam_m[:, 2] > 1e-6
    points = np.where(in_front[:, None], points_cam_m, [0.0, 0.0, 1.0])
    radius = np.hypot(points[:, 0], points[:, 1]) / points[:, 2]
    zero = np.zeros(3)
    # OpenCV differentiates by its own rotation and translation; at zero rotation d/d(translation) is d/d(point).
    if camera.distortion_model == "equidistant":
        pixels, jacobian = cv2.fisheye.projectPoints(points[:, None], zero, zero, _matrix(camera), camera.distortion)
        by_point = jacobian[:, 11:14]
    else:
        pixels, jacobian = cv2.projectPoints(points, zero, zero, _matrix(camera), _distortion(camera))[:2]
        by_point = jacobian[:, 3:6]
    return pixels.reshape(-1, 2), by_point.reshape(-1, 2, 3), in_front & (radius < max_radius(camera))


def undistort(
    pixels: Float[np.ndarray, "n 2"], camera: Camera
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Normalised coordinates (x/z, y/z) of distorted pixels, and whether the model reaches them.

    A pixel that no direction within the model's range projects to is marked False and given as (0, 0).
    """
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    points = np.ascontiguousarray(pixels, dtype=np.float64)[:, None]
    if camera.distortion_model == "equidistant":
        normalised = cv2.fisheye.undistortPoints(points, _matrix(camera), camera.distortion, criteria=criteria)
    else:
        normalised = cv2.undistortPoints(points, _matrix(camera), _distortion(camera), criteria=criteria)
    normalised = normalised.reshape(-1, 2)
    # An inversion that diverged returns huge or non-finite numbers: projecting back is the test that catches all kinds.
    usable = np.all(np.isfinite(normalised), axis=1) & (np.max(np.abs(normalised), axis=1) < 1e3)
    candidate = np.where(usable[:, None], normalised, 0.0)
    back, _, in_range = project(np.column_stack([candidate, np.ones(len(candidate))]), camera)
    ok = usable & in_range & (np.max(np.abs(back - pixels), axis=1) < _ROUND_TRIP_PX)
    return np.where(ok[:, None], candidate, 0.0), ok


def max_radius(camera: Camera) -> float:
    """Largest normalised radius tan(angle off axis) up to which the radial distortion grows, capped at 89 degrees.

    Radtan: r(1 + k1 r^2 + k2 r^4 + k3 r^6); equidistant: a(1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) of the angle a.
    The limit is the first positive root of the derivative (tangential terms are left out).
    """
    return _max_radius(camera.distortion_model, tuple(camera.distortion.tolist()))


@functools.lru_cache(maxsize=256)
def _max_radius(model: str, distortion: tuple[float, ...]) -> float:
    cap = float(np.tan(_MAX_ANGLE_RAD))
    if model == "none":
        return cap
    radial = np.array(distortion if model == "equidistant" else [*distortion[:2], *distortion[4:]])
    derivative = np.concatenate([[1.0], radial * np.arange(3, 3 + 2 * len(radial), 2)])
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(derivative, "b"))  # in the square of the variable
    turning = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)]
    if turning.size == 0:
        return cap
    first = float(np.sqrt(turning.min()))
    if model == "equidistant":
        return float(np.tan(min(first, _MAX_ANGLE_RAD)))
    return min(first, cap)


def _matrix(camera: Camera) -> Float[np.ndarray, "3 3"]:
    fx, fy, cx, cy = camera.intrinsics_px
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _distortion(camera: Camera) -> Float[np.ndarray, "k"]:
    return camera.distortion if camera.distortion.size else np.zeros(4)
