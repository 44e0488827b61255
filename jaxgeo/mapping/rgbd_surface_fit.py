"""The motion between two RGB-D keyframes from features and surfaces together."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.geometry import rigid
from jaxgeo.mapping.rgbd_keyframe import RgbdKeyframe
from jaxgeo.odometry.registration import prepare_cloud, register


@dataclasses.dataclass(frozen=True)
class SurfaceSettings:
    """How the surfaces' own registration joins the features' motion.

    Attributes:
        voxel_m: the clouds are thinned to one point in it.
        max_distance_m: between partners.
        max_shift_m, max_turn_rad: a registration further than this from the features' motion slid away: not used.
        normal_sigma_m: standard deviation of a surface's place along its normal.
        determined_share: a direction told less well than this share of the best told one is told by the noise of the
            normals: a wall seems to hold the frames in its own plane too. Its information fades with the square.
        correlated_points: so many neighbouring points err alike and count as one.
        feature_floor_m, feature_floor_rad: standard deviations that no number of features averages out. A focal length
            wrong by 5 % turns 10 degrees into 9.5; colour and depth of unregistered images differ by a few pixels.
        surface_floor_m, surface_floor_rad: the same of surfaces.
    """

    voxel_m: float = 0.05
    max_distance_m: float = 0.1
    max_shift_m: float = 0.15
    max_turn_rad: float = float(np.deg2rad(5.0))
    normal_sigma_m: float = 0.01
    determined_share: float = 0.05
    correlated_points: float = 50.0
    feature_floor_m: float = 0.015
    feature_floor_rad: float = float(np.deg2rad(0.7))
    surface_floor_m: float = 0.01
    surface_floor_rad: float = float(np.deg2rad(0.3))


# GICP takes every surface for a disc of variance 1e-3 along its normal (and 1 across), two of which meet in a pair.
_GICP_VARIANCE = 2e-3


def fit_surfaces(
    first: RgbdKeyframe,
    second: RgbdKeyframe,
    T_first_second: Float[np.ndarray, "4 4"],
    covariance: Float[np.ndarray, "6 6"],
    settings: SurfaceSettings,
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6 6"]]:
    """Mean and covariance of the features' motion and the surfaces' registration, weighted by their information.

    Along a wall, or round a ball, surfaces say nothing and the features rule; elsewhere surfaces are the better, since
    they need neither a lens model nor the registration of colour and depth. Each has errors of its own that no number
    of points averages out: its floor, added before the two are weighted.

    Args:
        covariance: of x in `T_first_second Exp(x)`, by the features, without a floor.
    """
    by_features = covariance + _floor(settings.feature_floor_m, settings.feature_floor_rad)
    clouds = [prepare_cloud(keyframe.points_m, settings.voxel_m) for keyframe in (first, second)]
    found = register(clouds[0], clouds[1], T_first_second, settings.max_distance_m)
    apart = rigid.log(rigid.inverse(T_first_second) @ found.T_target_source)
    slid = np.linalg.norm(apart[:3]) > settings.max_shift_m or np.linalg.norm(apart[3:]) > settings.max_turn_rad
    if slid or not found.converged or not np.all(np.isfinite(found.information)):
        return T_first_second, by_features
    scale = _GICP_VARIANCE / (settings.normal_sigma_m**2 * settings.correlated_points)
    told = _determined(found.information, clouds[1].points_m, settings.determined_share)
    random = np.linalg.inv(scale * told + 1e-3 * np.eye(6))
    by_surfaces = np.linalg.inv(random + _floor(settings.surface_floor_m, settings.surface_floor_rad))
    together = np.linalg.inv(np.linalg.inv(by_features) + by_surfaces)
    return T_first_second @ rigid.exp(together @ by_surfaces @ apart), together


def _determined(
    information: Float[np.ndarray, "6 6"], points_m: Float[np.ndarray, "n 3"], share: float
) -> Float[np.ndarray, "6 6"]:
    """The information without the directions that only the noise of the normals tells.

    Directions are compared at the points' centroid, in lengths: turns times the points' spread about it.
    """
    centre = points_m.mean(axis=0)
    spread_m = np.sqrt(np.mean(np.sum((points_m - centre) ** 2, axis=1)))
    at_centre = np.eye(4)
    at_centre[:3, 3] = centre
    to_lengths = rigid.adjoint(at_centre) @ np.diag(np.repeat([1.0, 1.0 / spread_m], 3))
    values, vectors = np.linalg.eigh(to_lengths.T @ information @ to_lengths)
    values = np.maximum(values, 0.0)
    values *= np.minimum(1.0, values / (share * values.max())) ** 2
    back = np.linalg.inv(to_lengths)
    return back.T @ (vectors * values) @ vectors.T @ back


def _floor(sigma_m: float, sigma_rad: float) -> Float[np.ndarray, "6 6"]:
    return np.diag(np.repeat([sigma_m, sigma_rad], 3) ** 2)
