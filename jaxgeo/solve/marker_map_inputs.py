"""What a marker map is built from: sightings checked, and both poses of each in the body frame."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.associate.camera_model import check_camera, undistort
from jaxgeo.associate.planar import UNIT_CORNERS, square_poses
from jaxgeo.data import CornerSightings, Rig
from jaxgeo.errors import SightingError, UndeterminedError
from jaxgeo.geometry.robust import RobustKind
from jaxgeo.solve.marker_camera import lens_parts
from jaxgeo.solve.marker_map_start import Candidates, Poses, groups_seen_together, sighting_error_px

MOST_MARKERS = 500
MAX_STEPS = 200


class MapSettings(eqx.Module):
    """How to solve.

    Attributes:
        loss, width: robust loss on a sighting's RMS residual, in its standard deviations.
        floor_px: what is added in quadrature to every corner's own sigma: errors of lens and print, common to all.
        refine_camera: whether focal scale, principal point, k1 and k2 are unknowns with weak priors.
        origin: the marker that is the frame; None: the one seen in most images.
        max_steps: of each joint solve.
    """

    loss: RobustKind = "cauchy"
    width: float = 3.0
    floor_px: float = 0.1
    refine_camera: bool = False
    origin: str | None = None
    max_steps: int = MAX_STEPS


class MapInputs(eqx.Module):
    """What does not change while the map is solved.

    Attributes:
        corners: the sightings, s of them.
        marker, stamp_s: distinct ids and stamps; `candidates.marker` and `candidates.image` are rows of them.
        candidates: both planar poses of each sighting, and its camera.
        intrinsics_px, distortion, fisheye: of each sighting, as `lens_parts` gives them.
        covariance_px2: of its corners, the floor added.
        slot: image, and place among the sightings of the image.
        origin: row of the marker that is the frame.
    """

    corners: CornerSightings
    marker: np.ndarray
    stamp_s: np.ndarray
    candidates: Candidates
    intrinsics_px: Float[np.ndarray, "s 4"]
    distortion: Float[np.ndarray, "s 5"]
    fisheye: Bool[np.ndarray, "s"]
    covariance_px2: Float[np.ndarray, "s 8 8"]
    slot: Int[np.ndarray, "2 s"]
    origin: int


def map_inputs(
    corners: CornerSightings, rig: Rig, side_m: float, pixel_sigma_px: float, settings: MapSettings
) -> MapInputs:
    """Check the sightings and find both poses of each.

    Raises:
        SightingError, UndeterminedError: as `jaxgeo.solve.marker_map.build_marker_map` says.
    """
    _check(corners, rig, side_m, pixel_sigma_px, settings)
    marker, marker_row = np.unique(corners.marker, return_inverse=True)
    stamp_s, image_row = np.unique(corners.stamp_s, return_inverse=True)
    _check_markers(corners, marker, marker_row, image_row)
    parts = [lens_parts(rig.cameras[str(name)]) for name in corners.camera]
    return MapInputs(
        corners=corners,
        marker=marker,
        stamp_s=stamp_s,
        candidates=_candidates(corners, rig, side_m, image_row, marker_row),
        intrinsics_px=np.array([part[0] for part in parts]),
        distortion=np.array([part[1] for part in parts]),
        fisheye=np.array([part[2] for part in parts]),
        covariance_px2=_covariances(corners, pixel_sigma_px, settings.floor_px),
        slot=np.stack([image_row, _place_within(image_row)]),
        origin=_origin(marker, marker_row, settings),
    )


def _origin(marker: np.ndarray, marker_row: Int[np.ndarray, "s"], settings: MapSettings) -> int:
    if settings.origin is None:
        return int(np.argmax(np.bincount(marker_row)))
    if settings.origin not in marker:
        raise SightingError(
            f"the origin {settings.origin!r} is not among the markers seen: {', '.join(map(str, marker[:20]))}."
        )
    return int(np.flatnonzero(marker == settings.origin)[0])


def _covariances(corners: CornerSightings, pixel_sigma_px: float, floor_px: float) -> Float[np.ndarray, "s 8 8"]:
    covariance = np.tile(pixel_sigma_px**2 * np.eye(8), (len(corners), 1, 1))
    own = corners.covariance_px2
    if own is not None:
        known = np.all(np.isfinite(own), axis=(1, 2))
        covariance = np.where(known[:, None, None], own, covariance)
    lowest = np.linalg.eigvalsh(covariance)[:, 0]
    if not np.all(lowest > 0.0):
        raise SightingError(
            f"{corners.source[np.argmin(lowest)]}: the covariance of its corners is not positive definite; expected "
            "(8, 8), pixels squared."
        )
    return covariance + floor_px**2 * np.eye(8)


def _place_within(image_row: Int[np.ndarray, "s"]) -> Int[np.ndarray, "s"]:
    """0, 1, 2 .. among the rows of the same image."""
    order = np.argsort(image_row, kind="stable")
    first = np.searchsorted(image_row[order], image_row[order])
    place = np.empty_like(image_row)
    place[order] = np.arange(len(image_row)) - first
    return place


def _check(corners: CornerSightings, rig: Rig, side_m: float, pixel_sigma_px: float, settings: MapSettings) -> None:
    for name, value in (("marker side", side_m), ("pixel sigma", pixel_sigma_px)):
        if not (np.isfinite(value) and value > 0.0):
            raise SightingError(f"the {name} is {value}; expected a number above zero.")
    if len(corners) == 0:
        raise SightingError("there are no marker corners to map.")
    for name in np.unique(corners.camera):
        if str(name) not in rig.cameras:
            raise SightingError(
                f"{corners.source[np.flatnonzero(corners.camera == name)[0]]}: camera '{name}' is not in the rig, "
                f"which has {', '.join(rig.cameras)}. Name it there, or read the table with camera_names."
            )
        check_camera(str(name), rig.cameras[str(name)])
    bad = ~np.all(np.isfinite(corners.corners_px), axis=(1, 2))
    if bad.any():
        raise SightingError(f"{corners.source[np.argmax(bad)]}: marker corners are not finite numbers.")
    names = np.unique(corners.camera)
    if settings.refine_camera and len(names) > 1:
        raise SightingError(
            f"cameras {', '.join(map(str, names))} took the images; one camera can be refined. Map one camera's rows."
        )


def _check_markers(corners: CornerSightings, marker: np.ndarray, marker_row: np.ndarray, image_row: np.ndarray) -> None:
    if "" in marker:
        raise SightingError(
            f"{corners.source[np.flatnonzero(corners.marker == '')[0]]}: the sighting has no marker id; a map needs "
            "the ids. Leave the row out, or detect markers with ids."
        )
    camera_row = np.unique(corners.camera, return_inverse=True)[1]
    key = np.unique(np.stack([camera_row, marker_row, image_row]), axis=1, return_inverse=True)[1]
    count = np.bincount(key)
    if np.any(count > 1):
        first, second = np.flatnonzero(key == np.argmax(count))[:2]
        raise SightingError(
            f"{corners.source[first]} and {corners.source[second]}: marker {str(corners.marker[first])!r} is seen "
            "twice in one image; a map needs every id once. Remove the wrong row, or the markers that share the id."
        )
    if len(marker) > MOST_MARKERS:
        raise SightingError(
            f"{len(marker)} markers; the dense system of the markers holds at most {MOST_MARKERS}. Map parts."
        )
    if len(marker) == 1:
        raise UndeterminedError(
            f"only marker {str(marker[0])!r} was seen: its pose is the frame, and nothing is left to map. Take images "
            "that show two or more markers."
        )
    groups = groups_seen_together(image_row, marker_row, len(marker))
    if len(groups) > 1:
        named = "; ".join("{" + ", ".join(map(str, marker[group][:10])) + "}" for group in groups[:6])
        raise UndeterminedError(
            f"the markers form {len(groups)} groups that no image links: {named}. Take an image that shows markers of "
            "both, or map one group alone with --only."
        )


def _candidates(
    corners: CornerSightings, rig: Rig, side_m: float, image_row: np.ndarray, marker_row: np.ndarray
) -> Candidates:
    n = len(corners)
    normalised, reached = np.zeros((n, 4, 2)), np.zeros(n, dtype=bool)
    R_cam_body, t_cam_body = np.zeros((n, 3, 3)), np.zeros((n, 3))
    for name in np.unique(corners.camera):
        rows = np.flatnonzero(corners.camera == name)
        camera = rig.cameras[str(name)]
        flat, ok = undistort(corners.corners_px[rows].reshape(-1, 2), camera)
        normalised[rows], reached[rows] = flat.reshape(-1, 4, 2), ok.reshape(-1, 4).all(axis=1)
        back = Rotation.from_quat(camera.quat_body_cam_wxyz, scalar_first=True).as_matrix().T
        R_cam_body[rows], t_cam_body[rows] = back, -back @ camera.t_body_cam_m
    if not reached.all():
        raise SightingError(
            f"{corners.source[np.argmin(reached)]}: corners outside the range of the camera's distortion model "
            f"({np.count_nonzero(~reached)} such rows). Remove the rows, or check the intrinsics."
        )
    R, t = square_poses(normalised, np.full(n, side_m))
    forth = np.swapaxes(R_cam_body, 1, 2)[:, None]
    R, t = forth @ R, (forth @ (t - t_cam_body[:, None])[..., None])[..., 0]
    corners_m = np.tile(np.column_stack([side_m * UNIT_CORNERS, np.zeros(4)]), (n, 1, 1))
    focal = np.array([np.sqrt(np.prod(rig.cameras[str(name)].intrinsics_px[:2])) for name in corners.camera])
    found = Candidates(
        R, t, np.zeros((n, 2)), image_row, marker_row, normalised, focal, corners_m, R_cam_body, t_cam_body
    )
    body = Poses(np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3)))
    error = [sighting_error_px(found, np.arange(n), body, Poses(R[:, k], t[:, k])) for k in (0, 1)]
    return found._replace(error_px=np.stack(error, axis=1))
