"""Loop closures between LiDAR submaps: candidates, each verified."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxgeo.geometry.rigid import apply, inverse, turn_rad
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.closure_noise import registration_covariance, weakest_direction
from jaxgeo.mapping.loop_candidates import LoopCandidate
from jaxgeo.odometry.registration import PreparedCloud, Registration, prepare_cloud, register


@dataclasses.dataclass(frozen=True)
class VerificationSettings:
    """When two submaps count as one place. Lengths follow the voxel v of the fine clouds.

    Attributes:
        coarse: the first registration's voxel, in v; partners at most `coarse_reach` of it apart.
        min_share: agreement that both submaps must reach (see `agreement`), of the fine clouds.
        min_coarse_share: of the coarse clouds, for the fine registration to be tried.
        max_return_m, max_return_rad: first to second and back again may be off the identity by so much; in v, in rad.
        rival_share: another hypothesis that reaches this part of the best one's agreement makes it ambiguous.
        floor_m, floor_rad: sigmas that no number of points goes below; see `registration_covariance`.
        slide, slide_reach: how far the result is displaced along its weakest direction, to see whether it comes back,
            in v; with partners so far apart, in coarse voxels: a longer reach would tie the submaps' ends to one
            another, which lie where the sensors' sight ended and are no part of the scene.
    """

    coarse: float = 3.0
    coarse_reach: float = 3.5
    min_share: float = 0.3
    min_coarse_share: float = 0.15
    max_return_m: float = 0.5
    max_return_rad: float = 0.02
    rival_share: float = 0.85
    slide: float = 6.0
    slide_reach: float = 1.5
    floor_m: float = 0.02
    floor_rad: float = 0.003


@dataclasses.dataclass(frozen=True)
class Surface:
    """A thinned cloud with normals and search tree."""

    cloud: PreparedCloud
    normal: Float[np.ndarray, "n 3"]
    tree: KDTree
    voxel_m: float


@dataclasses.dataclass(frozen=True)
class LidarPlace:
    """A submap, in the body frame of its keyframe, at the two resolutions that verification works at."""

    fine: Surface
    coarse: Surface


def lidar_place(
    submap_m: Float[np.ndarray, "n 3"], voxel_m: float, settings: VerificationSettings, threads: int = 1
) -> LidarPlace:
    """Prepare a submap for verification."""

    def surface(size_m: float) -> Surface:
        cloud = prepare_cloud(submap_m, size_m, threads)
        return Surface(cloud, np.asarray(cloud.cloud.normals())[:, :3], KDTree(cloud.points_m), size_m)

    return LidarPlace(surface(voxel_m), surface(settings.coarse * voxel_m))


def lidar_closures(
    candidates: Sequence[LoopCandidate],
    place: Callable[[int], LidarPlace | None],
    settings: VerificationSettings | None = None,
    *,
    threads: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Closure], Counter[str]]:
    """The candidates whose submaps fit, and how many were refused, by reason.

    Args:
        place: the prepared submap of a keyframe; None where it holds too few points.
        on_progress: called with the candidates looked at and their number.
    """
    settings = settings or VerificationSettings()
    closures, refused = [], Counter()
    for done, candidate in enumerate(candidates, start=1):
        first, second = place(candidate.first), place(candidate.second)
        if first is None or second is None:
            refused["too few points"] += 1
        else:
            found = verify(candidate, first, second, settings, threads)
            if isinstance(found, str):
                refused[found] += 1
            else:
                closures.append(found)
        if on_progress is not None:
            on_progress(done, len(candidates))
    return closures, refused


def verify(
    candidate: LoopCandidate, first: LidarPlace, second: LidarPlace, settings: VerificationSettings, threads: int = 1
) -> Closure | str:
    """The closure, or why there is none.

    Every start is registered coarsely; the distinct results that agree are registered finely, and the best one must
    agree from both sides, lead back to the identity, and stay alone: also when pushed along its weakest direction.
    """
    hypotheses = _coarse_hypotheses(candidate.starts, first, second, settings, threads)
    if not hypotheses:
        return "no agreement"
    fine = sorted((_fine(T, first, second, threads) for T in hypotheses), key=lambda tried: tried[1], reverse=True)
    best, share = fine[0]
    if share < settings.min_share:
        return "no agreement"
    T = best.T_target_source
    if any(_differ(T, other.T_target_source, first) and s > settings.rival_share * share for other, s in fine[1:]):
        return "ambiguous"
    if not _returns(T, first, second, settings, threads):
        return "no way back"
    if _slides(best, first, second, settings, threads):
        return "ambiguous"
    n_partners = round(best.inlier_share * len(second.fine.cloud))
    covariance = registration_covariance(best, n_partners, settings.floor_m, settings.floor_rad)
    information = np.linalg.inv(covariance)
    return Closure(candidate.first, candidate.second, T, 0.5 * (information + information.T), share, "lidar")


def agreement(target: Surface, source: Surface, T_target_source: Float[np.ndarray, "4 4"]) -> float:
    """Share of points that lie on the other's surface, the smaller one of both ways.

    On it: a partner within two voxels, half a voxel off its plane at most, with a normal within 37 degrees of its own.
    """
    return min(_on_surface(target, source, T_target_source), _on_surface(source, target, inverse(T_target_source)))


def _on_surface(target: Surface, source: Surface, T_target_source: Float[np.ndarray, "4 4"]) -> float:
    points = apply(T_target_source, source.cloud.points_m)
    distance, row = target.tree.query(points, distance_upper_bound=2.0 * target.voxel_m)
    there = np.flatnonzero(np.isfinite(distance))
    normal = target.normal[row[there]]
    off_plane = np.abs(np.sum(normal * (points[there] - target.cloud.points_m[row[there]]), axis=1))
    alike = np.abs(np.sum(normal * (source.normal[there] @ T_target_source[:3, :3].T), axis=1))
    return float(np.count_nonzero((off_plane < 0.5 * target.voxel_m) & (alike > 0.8)) / max(len(points), 1))


def _coarse(
    start: Float[np.ndarray, "4 4"], first: LidarPlace, second: LidarPlace, reach: float, threads: int
) -> tuple[Float[np.ndarray, "4 4"], float]:
    T = register(first.coarse.cloud, second.coarse.cloud, start, reach * first.coarse.voxel_m, threads).T_target_source
    return T, agreement(first.coarse, second.coarse, T)


def _coarse_hypotheses(
    starts: Float[np.ndarray, "s 4 4"],
    first: LidarPlace,
    second: LidarPlace,
    settings: VerificationSettings,
    threads: int,
) -> list[Float[np.ndarray, "4 4"]]:
    """Distinct results of the coarse registrations that agree, the best three."""
    found: list[tuple[float, Float[np.ndarray, "4 4"]]] = []
    for start in starts:
        T, share = _coarse(start, first, second, settings.coarse_reach, threads)
        if share >= settings.min_coarse_share and all(_differ(T, other, first) for _, other in found):
            found.append((share, T))
    return [T for _, T in sorted(found, key=lambda one: one[0], reverse=True)[:3]]


def _fine(
    start: Float[np.ndarray, "4 4"], first: LidarPlace, second: LidarPlace, threads: int
) -> tuple[Registration, float]:
    result = register(first.fine.cloud, second.fine.cloud, start, 2.0 * first.fine.voxel_m, threads)
    return result, agreement(first.fine, second.fine, result.T_target_source)


def _returns(
    T: Float[np.ndarray, "4 4"], first: LidarPlace, second: LidarPlace, settings: VerificationSettings, threads: int
) -> bool:
    """Whether the registration of the first to the second, begun at the result, leads back to where it came from."""
    back = register(second.fine.cloud, first.fine.cloud, inverse(T), 2.0 * first.fine.voxel_m, threads)
    round_trip = back.T_target_source @ T
    off_m = float(np.linalg.norm(round_trip[:3, 3]))
    return off_m < settings.max_return_m * first.fine.voxel_m and float(turn_rad(round_trip)) < settings.max_return_rad


def _slides(
    best: Registration, first: LidarPlace, second: LidarPlace, settings: VerificationSettings, threads: int
) -> bool:
    """Whether the result, displaced along its weakest direction, stays elsewhere and fits there as well."""
    T = best.T_target_source
    share = agreement(first.coarse, second.coarse, T)
    for sign in (-1.0, 1.0):
        pushed = T.copy()
        pushed[:3, 3] += sign * settings.slide * first.fine.voxel_m * (T[:3, :3] @ weakest_direction(best))
        settled, other_share = _coarse(pushed, first, second, settings.slide_reach, threads)
        if _differ(T, settled, first) and other_share > settings.rival_share * share:
            return True
    return False


def _differ(a: Float[np.ndarray, "4 4"], b: Float[np.ndarray, "4 4"], place: LidarPlace) -> bool:
    apart = inverse(a) @ b
    return bool(np.linalg.norm(apart[:3, 3]) > place.coarse.voxel_m or turn_rad(apart) > 0.1)
