"""How far one point cloud lies from another, point by nearest point."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxgeo.errors import InputError

# The distance below which the reference study counts a point as met.
_MET_M = 0.30


@dataclasses.dataclass(frozen=True)
class CloudDistance:
    """Distances from every point of one cloud to the nearest of another; `n` points measured."""

    mean_m: float
    median_m: float
    share_within_30cm: float
    n: int


def nearest_neighbour(a: Float[np.ndarray, "n _"], b: Float[np.ndarray, "m _"]) -> CloudDistance:
    """From A (n, 3) to B (m, 3), in one frame, metres; not the same from B to A.

    It says how two sessions agree only where each was georeferenced on its own: never after one was fitted to the
    other.

    Raises:
        InputError: an empty cloud, one that is not (n, 3), or coordinates that are not finite.
    """
    checked_cloud("the first", a)
    checked_cloud("the second", b)
    distance_m, _ = KDTree(b).query(a, workers=-1)
    return summary_of(distance_m)


def summary_of(distance_m: Float[np.ndarray, "n"]) -> CloudDistance:
    """Distances in the reference study's figures."""
    return CloudDistance(
        mean_m=float(np.mean(distance_m)),
        median_m=float(np.median(distance_m)),
        share_within_30cm=float(np.mean(distance_m <= _MET_M)),
        n=len(distance_m),
    )


def checked_cloud(name: str, cloud: np.ndarray) -> None:
    """Refuse what is no cloud.

    Raises:
        InputError: it is empty, not (n, 3), or not finite.
    """
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) == 0 or not np.isfinite(cloud).all():
        raise InputError(
            f"{name} cloud has shape {cloud.shape} and {int((~np.isfinite(cloud)).sum())} value(s) that are not "
            "finite: expected at least one point with x, y, z in metres, all finite. Drop invalid points first."
        )
