"""The motion between two RGB-D keyframes from their paired features, and whether to believe it."""

import dataclasses

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.geometry import rigid
from jaxgeo.mapping.depth_gates import DepthGates
from jaxgeo.mapping.rgbd_camera import RgbdCamera
from jaxgeo.mapping.rgbd_keyframe import RgbdKeyframe
from jaxgeo.mapping.rgbd_overlap import surface_share
from jaxgeo.mapping.rgbd_refinement import FeaturePairs, refine_motion
from jaxgeo.mapping.rgbd_surface_fit import SurfaceSettings, fit_surfaces


@dataclasses.dataclass(frozen=True)
class AlignmentSettings:
    """When two keyframes are taken to show one place.

    Attributes:
        max_angle_rad: between a feature's ray and its partner's point; 3.5 px at a focal length of 585 px.
        sigma_angle_rad: standard deviation of a feature's ray: its place in the image, the lens, colour against depth.
        min_inliers: pairs that agree, in each of the two directions.
        min_share: of the pairs that have a depth, that agree.
        min_hull: area of the convex hull of the agreeing features, as a share of the image, in both images.
        min_overlap: of the points of one that the other should see, the share that lie on its surface (the others lie
            in front of it, where it saw through); in both directions.
        surfaces: how the frames' surfaces join in; None: features alone.
    """

    max_angle_rad: float = 0.006
    sigma_angle_rad: float = 0.002
    min_inliers: int = 20
    min_share: float = 0.3
    min_hull: float = 0.04
    min_overlap: float = 0.6
    surfaces: SurfaceSettings | None = dataclasses.field(default_factory=SurfaceSettings)


@dataclasses.dataclass(frozen=True)
class Alignment:
    """Two keyframes that show one place.

    Attributes:
        T_first_second: (4, 4) of the body frames.
        information: (6, 6) of `Log(measured^-1 T_first^-1 T_second)`, (translation, rotation).
        n_inliers: pairs that agree.
        share: of the pairs with a depth.
        overlap: smaller of the two shares of points that lie on the other's surface.
    """

    T_first_second: Float[np.ndarray, "4 4"]
    information: Float[np.ndarray, "6 6"]
    n_inliers: int
    share: float
    overlap: float


def align_keyframes(
    first: RgbdKeyframe,
    second: RgbdKeyframe,
    matches: Int[np.ndarray, "m 2"],
    camera: RgbdCamera,
    settings: AlignmentSettings | None = None,
    gates: DepthGates | None = None,
) -> tuple[Alignment | None, str]:
    """`T_first_second` from paired features: PnP with RANSAC from both sides, refined on all that agree, then checked.

    The points of each frame are seen by the other: each direction gives a hypothesis, and the one with which more pairs
    agree, in rays and in depths, both ways, is refined by Gauss-Newton on the rays and depths of both images at once.

    Returns:
        the alignment and "", or None and why not.
    """
    settings, gates = settings or AlignmentSettings(), gates or DepthGates()
    a, b = matches.T
    pairs = FeaturePairs((first.rays[a], second.rays[b]), (first.depth_m[a], second.depth_m[b]))
    usable = np.isfinite(pairs.depth_m[0]) | np.isfinite(pairs.depth_m[1])
    if usable.sum() < settings.min_inliers:
        return None, "too few paired features"
    hypotheses = [_hypothesis(pairs, side, settings) for side in (0, 1)]
    agreeing = [(int(_agrees(pairs, T, settings, gates)[0].sum()), T) for T in hypotheses if T is not None]
    if not agreeing:
        return None, "no motion explains the paired features"
    T = max(agreeing, key=lambda pair: pair[0])[1]
    for _ in range(_REFINEMENTS):
        agree, sides = _agrees(pairs, T, settings, gates)
        if min(sides) < settings.min_inliers:
            return None, "too few features agree on one motion"
        T, covariance = refine_motion(pairs, agree, T, settings.sigma_angle_rad, gates)
    agree, sides = _agrees(pairs, T, settings, gates)
    share = float(agree.sum() / usable.sum())
    if min(sides) < settings.min_inliers or share < settings.min_share:
        return None, "too few features agree on one motion"
    hull = min(_hull_share(keyframe, matches[agree, side]) for side, keyframe in enumerate((first, second)))
    if hull < settings.min_hull:
        return None, "features agree in a corner of the image only"
    T_body = camera.T_body_cam @ T @ rigid.inverse(camera.T_body_cam)
    to_body = rigid.adjoint(camera.T_body_cam)
    covariance = to_body @ covariance @ to_body.T
    if settings.surfaces is not None:
        T_body, covariance = fit_surfaces(first, second, T_body, covariance, settings.surfaces)
    overlap = min(
        surface_share(first.points_m, second, rigid.inverse(T_body), camera, gates),
        surface_share(second.points_m, first, T_body, camera, gates),
    )
    if overlap < settings.min_overlap:
        return None, "surfaces contradict each other"
    information = np.linalg.inv(covariance)
    return Alignment(T_body, 0.5 * (information + information.T), int(agree.sum()), share, overlap), ""


_REFINEMENTS = 3  # each on the pairs that agree with the last


def _hypothesis(pairs: FeaturePairs, side: int, settings: AlignmentSettings) -> Float[np.ndarray, "4 4"] | None:
    """`T_cam1_cam2` by PnP of the points of one side in the image of the other (rays: unit focal length)."""
    points, rays = pairs.points_m(side), pairs.rays[1 - side]
    usable = np.all(np.isfinite(points), axis=1) & np.all(np.isfinite(rays), axis=1)
    if usable.sum() < max(settings.min_inliers, 4):
        return None
    found, rotation, translation, _ = cv2.solvePnPRansac(
        points[usable],
        rays[usable],
        np.eye(3),
        None,
        iterationsCount=1000,
        reprojectionError=settings.max_angle_rad,
        confidence=0.9999,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not found or not np.all(np.isfinite(rotation)) or not np.all(np.isfinite(translation)):
        return None
    T_other_own = np.eye(4)
    T_other_own[:3, :3] = Rotation.from_rotvec(rotation.ravel()).as_matrix()
    T_other_own[:3, 3] = translation.ravel()
    return rigid.inverse(T_other_own) if side == 0 else T_other_own


def _agrees(
    pairs: FeaturePairs, T_first_second: Float[np.ndarray, "4 4"], settings: AlignmentSettings, gates: DepthGates
) -> tuple[Bool[np.ndarray, "m"], tuple[int, int]]:
    """Pairs that fit in every way they can be tested, at least one; and how many from the points of either side."""
    refuted = np.zeros(len(pairs), dtype=bool)
    tested = np.zeros((2, len(pairs)), dtype=bool)
    for side, T in enumerate((rigid.inverse(T_first_second), T_first_second)):
        moved = pairs.points_m(side) @ T[:3, :3].T + T[:3, 3]
        known = np.all(np.isfinite(moved), axis=1) & np.all(np.isfinite(pairs.rays[1 - side]), axis=1)
        z = np.where(known, moved[:, 2], 1.0)
        off = np.linalg.norm(moved[:, :2] / np.maximum(z, 1e-3)[:, None] - pairs.rays[1 - side], axis=1)
        off_z = np.abs(z - pairs.depth_m[1 - side])
        allowed = _DEPTH_SIGMAS * np.hypot(gates.sigma_m(z), gates.sigma_m(pairs.depth_m[side])) + _DEPTH_SLACK_M
        refuted |= known & ((z <= 1e-3) | (off > settings.max_angle_rad) | (off_z > allowed))  # NaN refutes nothing
        tested[side] = known
    agree = tested.any(axis=0) & ~refuted
    return agree, (int((tested[0] & agree).sum()), int((tested[1] & agree).sum()))


_DEPTH_SIGMAS = 3.0
_DEPTH_SLACK_M = 0.02


def _hull_share(keyframe: RgbdKeyframe, rows: Int[np.ndarray, "m"]) -> float:
    """Area of the convex hull of some features, as a share of the image."""
    hull = cv2.convexHull(keyframe.features.points_px[rows].astype(np.float32))
    width, height = keyframe.features.resolution_px
    return float(cv2.contourArea(hull)) / (width * height)
