"""Which pairs of RGB-D keyframes are worth a closer look."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxgeo.mapping.image_likeness import image_vectors
from jaxgeo.mapping.rgbd_keyframe import RgbdKeyframe


@dataclasses.dataclass(frozen=True)
class CandidateSettings:
    """Where loop closures are looked for.

    Attributes:
        min_gap_s: keyframes nearer in time than this are tied by the odometry already.
        most_alike: pairs a keyframe, by the likeness of the images.
        nearest: pairs a keyframe, by the trajectory: the most alike of those that may be at one place.
        near_m: how far apart two cameras may be and still see the same things.
        drift_share: by how much of the path between two poses the trajectory may be wrong; widens `near_m`, up to
            `most_drift_m`.
        most_drift_m: beyond it proximity says nothing, and likeness alone decides.
        max_view_angle_rad: between the optical axes, for pairs that the trajectory proposes.
    """

    min_gap_s: float = 10.0
    most_alike: int = 5
    nearest: int = 5
    near_m: float = 1.5
    drift_share: float = 0.03
    most_drift_m: float = 5.0
    max_view_angle_rad: float = float(np.deg2rad(60.0))


def rgbd_candidates(
    keyframes: Sequence[RgbdKeyframe],
    T_map_cam: Float[np.ndarray, "k 4 4"] | None = None,
    settings: CandidateSettings | None = None,
) -> list[tuple[int, int]]:
    """Pairs (first < second), each once and in order, that look alike or that the trajectory brings together.

    Args:
        T_map_cam: poses of the cameras by the odometry; None: likeness alone.
    """
    settings = settings or CandidateSettings()
    if len(keyframes) < 2:
        return []
    stamp_s = np.array([keyframe.stamp_s for keyframe in keyframes])
    vectors = image_vectors([keyframe.features for keyframe in keyframes])
    near = dict(_near(T_map_cam, settings)) if T_map_cam is not None else {}
    pairs = set()
    for row in range(len(keyframes)):  # one row of likenesses at a time: no n x n matrix
        likeness = vectors @ vectors[row]
        far = np.abs(stamp_s - stamp_s[row]) >= settings.min_gap_s
        chosen = [_best(likeness, far, settings.most_alike)]
        if row in near:
            mask = np.zeros(len(keyframes), dtype=bool)
            mask[near[row]] = True
            chosen.append(_best(likeness, far & mask, settings.nearest))
        pairs |= {(min(row, int(other)), max(row, int(other))) for other in np.concatenate(chosen)}
    return sorted(pairs)


def _best(likeness: Float[np.ndarray, "n"], allowed: Bool[np.ndarray, "n"], most: int) -> Int[np.ndarray, "m"]:
    """The most alike of the allowed rows; exactly 0 is the likeness of an image without features."""
    rows = np.flatnonzero(allowed & (likeness != 0.0))
    return rows[np.argsort(-likeness[rows], kind="stable")[:most]]


def _near(
    T_map_cam: Float[np.ndarray, "k 4 4"], settings: CandidateSettings
) -> Iterator[tuple[int, Int[np.ndarray, "m"]]]:
    """For every keyframe, those that may have seen the same things: place within the drift, optical axes alike."""
    place_m, axis = T_map_cam[:, :3, 3], T_map_cam[:, :3, 2]
    path_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place_m, axis=0), axis=1))])
    tree = KDTree(place_m)
    for row, at in enumerate(place_m):
        rows = np.array(tree.query_ball_point(at, settings.near_m + settings.most_drift_m), dtype=np.int64)
        drift_m = np.minimum(settings.drift_share * np.abs(path_m[rows] - path_m[row]), settings.most_drift_m)
        close = np.linalg.norm(place_m[rows] - at, axis=1) <= settings.near_m + drift_m
        turned = axis[rows] @ axis[row] < np.cos(settings.max_view_angle_rad)
        yield row, rows[close & ~turned]
