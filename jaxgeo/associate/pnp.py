"""Marker corners to marker poses in the body frame, with covariance: PnP for all sightings at once."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import check_camera, project, undistort
from jaxgeo.associate.planar import UNIT_CORNERS, square_poses
from jaxgeo.data import Camera, CornerSightings, Rig, Sightings
from jaxgeo.errors import SightingError

# Eight pixel coordinates less six unknowns: the RMS residual expected of a right solution is sigma * sqrt(2 / 8).
_EXPECTED_RMS = 0.5
_MAX_STEPS = 30
_SETTLED_PX, _SETTLED_SIGMAS = 1e-7, 1e-4
_IMAGE_ROOM = 0.05  # of the image size


def corners_to_sightings(
    corners: CornerSightings,
    rig: Rig,
    marker_size_m: float | dict[str, float],
    pixel_sigma_px: float,
    *,
    ambiguity_ratio: float = 2.0,
    worst_fit: float = 5.0,
) -> tuple[Sightings, tuple[str, ...]]:
    """Poses `T_body_marker` of square markers from their four corners.

    Both planar solutions (IPPE) are refined on the distorted pixels and the one with the smaller error is kept.
    The covariance is pixel_sigma^2 (J^T J)^-1 of the reprojection Jacobian J: random corner noise only, local to the
    kept solution. Where the corners carry a covariance C of their own, r^T C^-1 r is minimised instead and the
    covariance is (J^T C^-1 J)^-1; everything below said in pixel sigmas is then in standard deviations of C.

    Args:
        marker_size_m: side length, one for all, or by marker id with an optional entry "default".
        pixel_sigma_px: standard deviation of each corner coordinate.
        ambiguity_ratio: a sighting is ambiguous where RMS2 < ratio * max(RMS1, sigma / 2). The floor is the RMS
            that corner noise alone leaves (eight coordinates, six unknowns), so that a lucky fit does not look
            unique. With the default 2 and pure noise the flag means chi2_2 - chi2_1 below about 6: odds of the
            kept solution under 20 to 1.
        worst_fit: corners whose RMS error exceeds this many pixel sigmas are not of one square.

    Returns:
        the sightings, in the order given, and warnings: corners outside the image or the camera model's range, that
        no marker in front of the camera explains, or that fit worse than `worst_fit` are left out and counted there.

    Raises:
        SightingError: a camera that is not in the rig, a marker without a size, a size or sigma that is not positive,
            corners that are not numbers, no usable sighting at all.
    """
    size_m = _sizes(corners, marker_size_m)
    _check(corners, rig, pixel_sigma_px)
    n = len(corners)
    rotation, translation = np.full((n, 3, 3), np.nan), np.full((n, 3), np.nan)
    covariance = np.full((n, 6, 6), np.nan)
    rms = np.full((n, 2), np.nan)
    reprojection_px = np.full(n, np.nan)
    in_range = np.zeros(n, dtype=bool)
    whiten = _whitening(corners, pixel_sigma_px)
    # What residuals are in: pixels, or standard deviations where corners carry a covariance.
    unit = pixel_sigma_px if whiten is None else 1.0
    for name in np.unique(corners.camera):
        rows = np.flatnonzero(corners.camera == name)
        camera = rig.cameras[str(name)]
        normalised, reached = undistort(corners.corners_px[rows].reshape(-1, 2), camera)
        in_range[rows] = reached.reshape(-1, 4).all(axis=1) & _in_image(corners.corners_px[rows], camera)
        rows, normalised = rows[in_range[rows]], normalised.reshape(-1, 4, 2)[in_range[rows]]
        if rows.size:
            white = None if whiten is None else whiten[rows]
            R_cam, t_cam, rms[rows], reprojection_px[rows], information = _solve(
                normalised, corners.corners_px[rows], size_m[rows], camera, white
            )
            R_body_cam = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).as_matrix()
            rotation[rows] = R_body_cam @ R_cam
            translation[rows] = t_cam @ R_body_cam.T + camera.t_body_cam_m
            axes = np.kron(np.eye(2), R_body_cam)
            covariance[rows] = unit**2 * axes @ _invert(information) @ axes.T
    solved = np.isfinite(rms[:, 0]) & np.all(np.isfinite(covariance), axis=(1, 2))
    kept = solved & (rms[:, 0] <= worst_fit * unit)
    warnings = _refusals(
        corners,
        {
            "have corners outside the image or the range of the camera's distortion model": ~in_range,
            "have corners that no marker in front of the camera explains (degenerate or behind it)": in_range & ~solved,
            f"fit a square worse than {worst_fit:g} times {_unit_words(whiten, pixel_sigma_px)}": solved & ~kept,
        },
    )
    second = np.where(np.isnan(rms[:, 1]), np.inf, rms[:, 1])
    ambiguous = second < ambiguity_ratio * np.maximum(rms[:, 0], _EXPECTED_RMS * unit)
    quaternion = np.full((n, 4), np.nan)
    quaternion[kept] = Rotation.from_matrix(rotation[kept]).as_quat(scalar_first=True)
    sightings = Sightings(
        stamp_s=corners.stamp_s,
        marker=corners.marker,
        t_body_marker_m=translation,
        quat_body_marker_wxyz=quaternion,
        covariance=covariance,
        ambiguous=ambiguous,
        reprojection_px=reprojection_px,
        source=corners.source,
    )
    return sightings.take(np.flatnonzero(kept)), warnings


def _whitening(corners: CornerSightings, pixel_sigma_px: float) -> Float[np.ndarray, "n 8 8"] | None:
    """W with W^T W = C^-1 for each sighting (pixel_sigma where it has no covariance); None where none has one."""
    if corners.covariance_px2 is None:
        return None
    known = np.all(np.isfinite(corners.covariance_px2), axis=(1, 2))
    covariance = np.where(known[:, None, None], corners.covariance_px2, pixel_sigma_px**2 * np.eye(8))
    try:
        return np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        bad = int(np.argmin(np.linalg.eigvalsh(covariance)[:, 0]))
        raise SightingError(
            f"{corners.source[bad]}: the covariance of its corners is not positive definite; expected (8, 8), pixels "
            "squared."
        ) from None


def _unit_words(whiten: Float[np.ndarray, "n 8 8"] | None, pixel_sigma_px: float) -> str:
    return f"pixel_sigma_px = {pixel_sigma_px:g} px" if whiten is None else "the corners' own standard deviations"


def _sizes(corners: CornerSightings, marker_size_m: float | dict[str, float]) -> Float[np.ndarray, "n"]:
    by_id = marker_size_m if isinstance(marker_size_m, dict) else {"default": marker_size_m}
    for marker, size in by_id.items():
        if not (np.isfinite(size) and size > 0.0):
            raise SightingError(
                f"marker size of '{marker}' is {size} m; expected the side length, above zero, in metres."
            )
    ids = [str(marker) for marker in corners.marker]
    missing = sorted({marker for marker in ids if marker not in by_id}) if "default" not in by_id else []
    if missing:
        raise SightingError(
            f"no marker size for id {', '.join(repr(m) for m in missing[:10])} (of {len(missing)} without one); "
            f"sizes are given for {', '.join(sorted(by_id)) or 'none'}. Add them, or an entry 'default'."
        )
    return np.array([by_id.get(marker, by_id.get("default", np.nan)) for marker in ids], dtype=np.float64)


def _check(corners: CornerSightings, rig: Rig, pixel_sigma_px: float) -> None:
    if not (np.isfinite(pixel_sigma_px) and pixel_sigma_px > 0.0):
        raise SightingError(f"pixel_sigma_px is {pixel_sigma_px}; expected a standard deviation above zero, in pixels.")
    if len(corners) == 0:
        raise SightingError("there are no marker corners to make sightings of.")
    for name in np.unique(corners.camera):
        if str(name) not in rig.cameras:
            first = corners.source[np.flatnonzero(corners.camera == name)[0]]
            raise SightingError(
                f"{first}: camera '{name}' is not in the rig, which has {', '.join(rig.cameras) or 'no cameras'}. "
                "Name it there, or map the file's name to a rig camera with `camera_names`."
            )
        check_camera(str(name), rig.cameras[str(name)])
    bad = np.flatnonzero(~np.all(np.isfinite(corners.corners_px), axis=(1, 2)))
    if bad.size:
        raise SightingError(f"{corners.source[bad[0]]}: marker corners are not finite numbers ({bad.size} such rows).")


def _in_image(corners_px: Float[np.ndarray, "n 4 2"], camera: Camera) -> Bool[np.ndarray, "n"]:
    """All four corners in the image, with a little room for extrapolated ones; True where its size is not known."""
    if camera.resolution_px is None:
        return np.ones(len(corners_px), dtype=bool)
    size_px = np.array(camera.resolution_px)
    room_px = _IMAGE_ROOM * size_px
    return np.all((corners_px >= -room_px) & (corners_px <= size_px + room_px), axis=(1, 2))


def _refusals(corners: CornerSightings, kinds: dict[str, Bool[np.ndarray, "n"]]) -> tuple[str, ...]:
    """One sentence for each kind of row left out; an error where no row is left."""
    sentences = []
    for what, refused in kinds.items():
        rows = np.flatnonzero(refused)
        if rows.size:
            named = ", ".join(str(corners.source[row]) for row in rows[:3]) + " ..." * (rows.size > 3)
            sentences.append(f"{rows.size} of {len(corners)} sightings {what} and are left out: {named}.")
    if sum(np.count_nonzero(refused) for refused in kinds.values()) == len(corners):
        raise SightingError(
            " ".join(sentences) + " None is left: check intrinsics, distortion model, corner order and pixel_sigma_px."
        )
    return tuple(sentences)


def _solve(
    normalised: Float[np.ndarray, "n 4 2"],
    pixels: Float[np.ndarray, "n 4 2"],
    size_m: Float[np.ndarray, "n"],
    camera: Camera,
    whiten: Float[np.ndarray, "n 8 8"] | None,
) -> tuple[
    Float[np.ndarray, "n 3 3"],
    Float[np.ndarray, "n 3"],
    Float[np.ndarray, "n 2"],
    Float[np.ndarray, "n"],
    Float[np.ndarray, "n 6 6"],
]:
    """Best pose of each marker in the camera, RMS residuals of both solutions (best first), the best one's RMS in
    pixels, and its J^T J.

    A solution behind the camera has RMS NaN; a row whose both solutions are behind it is NaN throughout.
    """
    n = len(normalised)
    rotations, translations = square_poses(normalised, size_m)
    corners_m = np.repeat(size_m, 2)[:, None, None] * np.column_stack([UNIT_CORNERS, np.zeros(4)])
    R, t = rotations.reshape(-1, 3, 3), translations.reshape(-1, 3)
    twice = None if whiten is None else np.repeat(whiten, 2, axis=0)
    R, t, error, information = refine(R, t, corners_m, np.repeat(pixels, 2, axis=0), camera, twice)
    rms = np.sqrt(error / 8.0).reshape(n, 2)
    order = np.argsort(rms, axis=1)  # NaN goes last
    best = 2 * np.arange(n) + order[:, 0]
    rms = np.take_along_axis(rms, order, axis=1)
    rms_px = rms[:, 0]
    if whiten is not None:
        residual_px = _linearise(R[best], t[best], corners_m[best], pixels, camera)[0]
        rms_px = np.where(np.isnan(rms[:, 0]), np.nan, np.sqrt(np.mean(residual_px**2, axis=1)))
    return R[best], t[best], rms, rms_px, information[best]


def refine(
    R: Float[np.ndarray, "n 3 3"],
    t: Float[np.ndarray, "n 3"],
    corners_m: Float[np.ndarray, "n 4 3"],
    pixels: Float[np.ndarray, "n 4 2"],
    camera: Camera,
    whiten: Float[np.ndarray, "n 8 8"] | None = None,
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n"], Float[np.ndarray, "n 6 6"]]:
    """Levenberg-Marquardt on the distorted pixels, every marker with its own damping.

    Args:
        whiten: multiplied to every residual and its derivative; None: residuals in pixels.

    Returns rotations, translations, squared residuals and J^T J at the end (tangent: translation added, rotation on
    the left, camera axes). A start that is not in front of the camera comes back with error NaN.
    """
    residual, jacobian, ok = _whitened(R, t, corners_m, pixels, camera, whiten)
    error = np.where(ok, np.sum(residual**2, axis=1), np.nan)
    information = np.swapaxes(jacobian, 1, 2) @ jacobian
    damping = np.full(len(R), 1e-3)
    settled = _SETTLED_PX if whiten is None else _SETTLED_SIGMAS
    active = np.flatnonzero(ok)
    R, t = R.copy(), t.copy()
    for _ in range(_MAX_STEPS):
        if active.size == 0:
            break
        A = information[active]
        diagonal = np.einsum("nii->ni", A)
        damped = (
            A
            + damping[active, None, None]
            * np.eye(6)
            * (diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True))[:, None]
        )
        gradient = np.einsum("nij,ni->nj", jacobian[active], residual[active])
        step = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        R_new = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ R[active]
        t_new = t[active] + step[:, :3]
        white = None if whiten is None else whiten[active]
        new_residual, new_jacobian, new_ok = _whitened(R_new, t_new, corners_m[active], pixels[active], camera, white)
        new_error = np.sum(new_residual**2, axis=1)
        better = new_ok & (new_error <= error[active])
        won = active[better]
        R[won], t[won], error[won] = R_new[better], t_new[better], new_error[better]
        residual[won], jacobian[won] = new_residual[better], new_jacobian[better]
        information[won] = np.swapaxes(jacobian[won], 1, 2) @ jacobian[won]
        damping[active] = np.where(better, damping[active] / 10.0, damping[active] * 10.0)
        # A step that moves no corner by this ends it; so does a damping that no longer lets anything move.
        predicted = np.linalg.norm(np.einsum("nij,nj->ni", new_jacobian, step), axis=1)
        active = active[(predicted > settled) & (damping[active] < 1e8)]
    return R, t, error, information


def _whitened(
    R: Float[np.ndarray, "n 3 3"],
    t: Float[np.ndarray, "n 3"],
    corners_m: Float[np.ndarray, "n 4 3"],
    pixels: Float[np.ndarray, "n 4 2"],
    camera: Camera,
    whiten: Float[np.ndarray, "n 8 8"] | None,
) -> tuple[Float[np.ndarray, "n 8"], Float[np.ndarray, "n 8 6"], Bool[np.ndarray, "n"]]:
    residual, jacobian, ok = _linearise(R, t, corners_m, pixels, camera)
    if whiten is None:
        return residual, jacobian, ok
    return (whiten @ residual[..., None])[..., 0], whiten @ jacobian, ok


def _linearise(
    R: Float[np.ndarray, "n 3 3"],
    t: Float[np.ndarray, "n 3"],
    corners_m: Float[np.ndarray, "n 4 3"],
    pixels: Float[np.ndarray, "n 4 2"],
    camera: Camera,
) -> tuple[Float[np.ndarray, "n 8"], Float[np.ndarray, "n 8 6"], Bool[np.ndarray, "n"]]:
    """Reprojection residuals, their derivative, and whether all four corners are in front of the camera."""
    turned = corners_m @ np.swapaxes(R, 1, 2)
    points = turned + t[:, None]
    finite = np.all(np.isfinite(points), axis=(1, 2))
    points = np.where(finite[:, None, None], points, [0.0, 0.0, -1.0])
    predicted, by_point, in_front = project(points.reshape(-1, 3), camera)
    by_point = by_point.reshape(-1, 4, 2, 3)
    # d(Exp(w) R X)/dw = -[R X]_x, and a row r times -[a]_x is the cross product a x r.
    by_rotation = np.cross(turned[:, :, None], by_point)
    jacobian = np.concatenate([by_point, by_rotation], axis=3).reshape(-1, 8, 6)
    jacobian = np.where(finite[:, None, None], jacobian, 0.0)
    return (predicted.reshape(-1, 4, 2) - pixels).reshape(-1, 8), jacobian, finite & in_front.reshape(-1, 4).all(axis=1)


def _invert(information: Float[np.ndarray, "n 6 6"]) -> Float[np.ndarray, "n 6 6"]:
    """Inverse scaled to unit diagonal first (metres and radians differ in size); NaN where it does not exist."""
    scale = np.sqrt(np.einsum("nii->ni", information))
    usable = np.all(np.isfinite(information), axis=(1, 2)) & np.all(scale > 0.0, axis=1)
    scale = np.where(usable[:, None], scale, 1.0)
    unit = np.where(usable[:, None, None], information, np.eye(6)) / scale[:, :, None] / scale[:, None, :]
    usable &= np.linalg.cond(unit) < 1e12
    inverse = np.linalg.inv(np.where(usable[:, None, None], unit, np.eye(6))) / scale[:, :, None] / scale[:, None, :]
    return np.where(usable[:, None, None], inverse, np.nan)
