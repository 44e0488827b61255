"""The growing map at three resolutions, and one scan matched with it from coarse to fine under a motion prior."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxgeo.geometry.rigid import exp, inverse, log
from jaxgeo.odometry.registration import PreparedCloud, VoxelMap, prepare_cloud, register
from jaxgeo.odometry.settings import OdometrySettings

# A point finds a partner only in its own voxel, so the largest voxel is how far a start may be off
VOXELS = (4.0, 2.0, 1.0)  # times the finest
THINNED_TO = 0.5  # of the finest voxel: covariances need neighbours inside it
SCOUT_THINNED_TO = 1.5
# Floors and walls often lie along the first scan's axes: askew to them, the voxels' sides coincide with no surface,
# which would scatter into the voxels on both sides of it
T_GRID_MAP = exp(np.array([0.37, 0.19, 0.23, 0.3, 0.4, 0.5]))
UNMATCHED_COST = 3.0  # of a point without partner, in half squared sigmas
# GICP makes of every neighbourhood a disc with a sigma of 1 m: two discs of one plane still weigh 1 / (1 + 1) 1/m^2
# along it, though they say nothing there
PLANE_WEIGHT = 0.5


@dataclasses.dataclass(frozen=True)
class Match:
    """One scan in the map.

    Attributes:
        T_map_lidar: the pose, the motion prior weighed in.
        inlier_share: share of the thinned points with a partner in the finest map.
        mapped_share: with one at the resolution where most have one: the points where the map reaches at all.
        cost: mean half squared Mahalanobis distance in the finest map, those without partner at `UNMATCHED_COST`.
        converged: the finest registration did.
        held: what the scan says of its weakest direction over what the motion prior says of it, as a ratio of
            information. Below 1 the motion model decided there: in a tunnel, or before a single wall.
    """

    T_map_lidar: Float[np.ndarray, "4 4"]
    inlier_share: float
    mapped_share: float
    cost: float
    converged: bool
    held: float


class ScanMap:
    """Voxel maps of three resolutions that grow together."""

    def __init__(self, voxel_m: float, settings: OdometrySettings) -> None:
        self.voxel_m = voxel_m
        self._settings = settings
        self._levels = [VoxelMap(factor * voxel_m, settings.map_horizon) for factor in VOXELS]

    def prepare(self, points_m: Float[np.ndarray, "n 3"]) -> PreparedCloud:
        """The scan, thinned, with the covariances that GICP weighs with."""
        return prepare_cloud(points_m, THINNED_TO * self.voxel_m, self._settings.threads)

    def thinned(self, cloud: PreparedCloud) -> PreparedCloud:
        """About a tenth of a prepared scan's points: enough to compare starts with."""
        return prepare_cloud(cloud.points_m, SCOUT_THINNED_TO * self.voxel_m, self._settings.threads)

    def insert(self, cloud: PreparedCloud, T_map_lidar: Float[np.ndarray, "4 4"]) -> None:
        """Add a scan at its pose."""
        for level in self._levels:
            level.insert(cloud, T_GRID_MAP @ T_map_lidar)

    def match(
        self,
        cloud: PreparedCloud,
        T_map_expected: Float[np.ndarray, "4 4"],
        sigma: Float[np.ndarray, "6"],
    ) -> Match:
        """Align a scan from its expected pose, whose standard deviations are `sigma` (m, rad).

        At each resolution registration's answer x, with information H, is weighed against the expectation:
        `x <- (H + P)^-1 H x`, P the prior's information. Where the scan holds all directions H is far larger and x
        stays; along a tunnel H says nothing and the expectation remains.
        """
        T, prior, shares = T_map_expected, np.diag(1.0 / np.square(sigma)), []
        for level in self._levels:
            found = register(level, cloud, T_GRID_MAP @ T, 2.0 * level.voxel_m)
            shares.append(found.inlier_share)
            information = _held_information(cloud, found.information, found.inlier_share)
            x = log(inverse(T_GRID_MAP @ T_map_expected) @ found.T_target_source)
            weighed = information / self._settings.points_per_measurement
            T = T_map_expected @ exp(np.linalg.solve(weighed + prior, weighed @ x))
        return Match(
            T,
            found.inlier_share,
            max(shares),
            found.error * found.inlier_share + UNMATCHED_COST * (1.0 - found.inlier_share),
            found.converged,
            float(np.linalg.eigvalsh(weighed * np.outer(sigma, sigma))[0]),
        )


def _held_information(
    cloud: PreparedCloud, information: Float[np.ndarray, "6 6"], inlier_share: float
) -> Float[np.ndarray, "6 6"]:
    """What the points say across their surfaces: without the weight that GICP gives them along these.

    A point p moves by `[I, -hat(p)]` times an increment (translation, rotation) in the sensor's frame.
    """
    p = cloud.points_m
    n, total, moments = len(p), p.sum(axis=0), p.T @ p
    lever = np.array([[0.0, total[2], -total[1]], [-total[2], 0.0, total[0]], [total[1], -total[0], 0.0]])
    along = np.block([[n * np.eye(3), lever], [lever.T, np.trace(moments) * np.eye(3) - moments]])
    values, vectors = np.linalg.eigh(information - PLANE_WEIGHT * inlier_share * along)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
