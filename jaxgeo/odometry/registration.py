"""Registration of point clouds: voxelised GICP. small_gicp lives here.

Koide, "small_gicp: Efficient and parallel algorithms for point cloud registration", JOSS 2024; GICP: Segal, Haehnel,
Thrun, "Generalized-ICP", RSS 2009.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.errors import InputError

# With ten, a sparse ring's neighbours all lie on the ring: its points then hold the sensor back along a road or tunnel
_NEIGHBOURS = 20
_MAX_ITERATIONS = 30


@dataclasses.dataclass(frozen=True)
class PreparedCloud:
    """A cloud thinned to one point a voxel, each with the covariance of its neighbourhood, and its search tree."""

    cloud: Any
    tree: Any

    def __len__(self) -> int:
        return self.cloud.size()

    @property
    def points_m(self) -> Float[np.ndarray, "n 3"]:
        return np.asarray(self.cloud.points())[:, :3]


@dataclasses.dataclass(frozen=True)
class Registration:
    """What aligning a source with a target gave.

    Attributes:
        T_target_source: (4, 4).
        inlier_share: share of the source's thinned points that found a partner.
        error: mean over these of half the squared Mahalanobis distance.
        information: (6, 6) Gauss-Newton Hessian at the end, (translation, rotation), of an increment in the source's
            frame: `T Exp(x)`. It counts every partner as an independent measurement, so it is far too confident.
        converged: the increments fell below the tolerance before the iterations ran out.
    """

    T_target_source: Float[np.ndarray, "4 4"]
    inlier_share: float
    error: float
    information: Float[np.ndarray, "6 6"]
    converged: bool


def prepare_cloud(points_m: Float[np.ndarray, "n 3"], voxel_m: float, threads: int = 1) -> PreparedCloud:
    """Thin a cloud and estimate the covariances that GICP weighs with.

    Raises:
        InputError: small_gicp is not installed.
    """
    cloud, tree = small_gicp().preprocess_points(
        np.ascontiguousarray(points_m, dtype=np.float64), voxel_m, _NEIGHBOURS, threads
    )
    return PreparedCloud(cloud, tree)


class VoxelMap:
    """A growing map of Gaussian voxels; those not seen for `horizon` insertions are forgotten (None: never)."""

    def __init__(self, voxel_m: float, horizon: int | None = None) -> None:
        self.voxel_m = voxel_m
        self._map = small_gicp().GaussianVoxelMap(voxel_m)
        self._map.set_lru(horizon or np.iinfo(np.int32).max // 2)

    def __len__(self) -> int:
        return self._map.size()

    def insert(self, cloud: PreparedCloud, T_map_cloud: Float[np.ndarray, "4 4"]) -> None:
        """Add a cloud at its pose."""
        self._map.insert(cloud.cloud, T_map_cloud)


def register(
    target: PreparedCloud | VoxelMap,
    source: PreparedCloud,
    T_target_source: Float[np.ndarray, "4 4"],
    max_distance_m: float,
    threads: int = 1,
    max_iterations: int = _MAX_ITERATIONS,
) -> Registration:
    """Align a source with a target from a first guess; partners are at most `max_distance_m` apart.

    Raises:
        InputError: small_gicp is not installed.
    """
    options = {
        "init_T_target_source": T_target_source,
        "max_correspondence_distance": max_distance_m,
        "num_threads": threads,
        "max_iterations": max_iterations,
    }
    if isinstance(target, VoxelMap):
        found = small_gicp().align(target._map, source.cloud, **options)
    else:
        found = small_gicp().align(target.cloud, source.cloud, target.tree, **options)
    n, inliers = max(len(source), 1), max(found.num_inliers, 1)
    order = [3, 4, 5, 0, 1, 2]  # small_gicp puts the rotation first
    return Registration(
        np.asarray(found.T_target_source),
        found.num_inliers / n,
        found.error / inliers,
        np.asarray(found.H)[np.ix_(order, order)],
        bool(found.converged),
    )


def small_gicp() -> Any:
    """The library, or a refusal that says how to install it."""
    try:
        import small_gicp
    except ImportError as failure:
        raise InputError(
            f"registering scans needs small_gicp, which cannot be imported ({failure}): pip install 'jaxgeo[cloud]'."
        ) from None
    return small_gicp
