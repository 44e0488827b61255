"""A scene to look at, and what each pose saw of it, so that a cloud can be carried with any corrected trajectory.

The scene is ground and facades, the same for every layout under one seed. A point is seen, range noise apart,
wherever a pose comes near enough: nothing hides anything.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError
from jaxgeo.simulate.course import course_of
from jaxgeo.simulate.layout import SURVEYED_ENH_M, UAV, UGV
from jaxgeo.simulate.session import SURVEY_STREAM, SimulatedSession

GROUND_POINTS, FACADE_POINTS = 14_000, 4_000
RANGE_M = 15.0
RANGE_SIGMA_M = 0.02
# How far the ground reaches beside the paths, how far outside the survey's bounds the facades stand, how high they are.
GROUND_M = 12.0
FACADE_AWAY_M, FACADE_HEIGHT_M = 8.0, 6.0
# Ground between the locations: weights 1 / (distance² + this²), and undulation on top.
BLEND_M, RIPPLE_M, RIPPLE_LENGTH_M = 5.0, 0.15, 7.0
# One sighting a point and pass: within a stretch of this length the nearest pose, and of neighbouring stretches the
# nearest only.
STRETCH_M = 6.0
# Of the ground's bounding box some half lies near a path.
TRIES = 4
SCENE, RANGE = 1, 2


@dataclasses.dataclass(frozen=True)
class CloudSightings:
    """Surface points as seen, each from one pose of a trajectory.

    Attributes:
        pose_index: (m,) the pose that saw it.
        point_body_m: (m, 3) in that pose's body frame.
        scene_index: (m,) which point of the scene it is; a point may be seen in several passes.
    """

    pose_index: Int[np.ndarray, "m"]
    point_body_m: Float[np.ndarray, "m 3"]
    scene_index: Int[np.ndarray, "m"]

    def __len__(self) -> int:
        return len(self.pose_index)


def scene_points_m(seed: int, n_ground: int = GROUND_POINTS, n_facade: int = FACADE_POINTS) -> Float[np.ndarray, "n 3"]:
    """Ground beside the study's two paths, then facades round the site; true local frame (E, N, h minus the origin)."""
    random = np.random.default_rng(np.random.SeedSequence([seed, 0], spawn_key=(SURVEY_STREAM, SCENE)))
    paths_m = np.concatenate([course_of(layout).pose.translation[::10, :2] for layout in (UAV, UGV)])
    # Evenly over the ground that lies near a path, whatever time the rig spends where.
    low, high = paths_m.min(axis=0) - GROUND_M, paths_m.max(axis=0) + GROUND_M
    ground_m = random.uniform(low, high, (TRIES * n_ground, 2))
    ground_m = ground_m[KDTree(paths_m).query(ground_m)[0] < GROUND_M][:n_ground]
    facade_m = _facade_foot_m(random.uniform(size=n_facade))
    height_m = random.uniform(0.0, FACADE_HEIGHT_M, n_facade)
    return np.concatenate(
        [
            np.column_stack([ground_m, ground_height_m(ground_m)]),
            np.column_stack([facade_m, ground_height_m(facade_m) + height_m]),
        ]
    )


def ground_height_m(place_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Ground through the surveyed locations, blended between them by distance, with undulations of a few decimetres."""
    away_m2 = np.sum((place_m[:, None] - SURVEYED_ENH_M[None, :, :2]) ** 2, axis=-1)
    weight = 1.0 / (away_m2 + BLEND_M**2)
    level_m = weight @ SURVEYED_ENH_M[:, 2] / weight.sum(axis=1)
    ripple = np.sin(place_m[:, 0] / RIPPLE_LENGTH_M) * np.cos(1.3 * place_m[:, 1] / RIPPLE_LENGTH_M)
    return level_m + RIPPLE_M * ripple


def see_scene(
    session: SimulatedSession,
    scene_m: Float[np.ndarray, "n 3"] | None = None,
    range_m: float = RANGE_M,
    range_sigma_m: float = RANGE_SIGMA_M,
) -> CloudSightings:
    """What the session's rig sees, in the order of its poses.

    A point is seen once in each pass, from the nearest pose of it; passes are told apart by stretches of the path that
    lie between them and are farther away.

    Args:
        session: its true trajectory sees; all of its trajectories have these poses.
        scene_m: default the scene of its seed.
        range_m: beyond this nothing is seen.
        range_sigma_m: noise along the ray.

    Raises:
        InputError: nothing lies within range.
    """
    scene_m = scene_points_m(session.seed) if scene_m is None else scene_m
    position_m = session.truth.position_m
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position_m, axis=0), axis=1))])
    stretch = (along_m / STRETCH_M).astype(int)
    first = np.searchsorted(stretch, np.arange(stretch[-1] + 1))
    near = [KDTree(poses).query(scene_m, distance_upper_bound=range_m) for poses in np.split(position_m, first[1:])]
    distance_m = np.column_stack([distance for distance, _ in near])  # infinite beyond the range
    far = np.full((len(scene_m), 1), np.inf)
    before, after = np.hstack([far, distance_m[:, :-1]]), np.hstack([distance_m[:, 1:], far])
    point, part = np.nonzero(np.isfinite(distance_m) & (distance_m <= before) & (distance_m < after))
    if not len(point):
        raise InputError(f"no point of the scene lies within {range_m:g} m of the path; expected some in sight.")
    pose_index = first[part] + np.column_stack([index for _, index in near])[point, part]
    order = np.lexsort((point, pose_index))
    point, pose_index = point[order], pose_index[order]
    attitude = Rotation.from_quat(session.truth.quat_wxyz[pose_index], scalar_first=True)
    seen_m = attitude.inv().apply(scene_m[point] - position_m[pose_index])
    random = np.random.default_rng(
        np.random.SeedSequence([session.seed, session.layout.stream], spawn_key=(SURVEY_STREAM, RANGE))
    )
    length_m = np.linalg.norm(seen_m, axis=1, keepdims=True)
    noise_m = range_sigma_m * random.standard_normal((len(point), 1))
    return CloudSightings(pose_index, seen_m * (1.0 + noise_m / np.maximum(length_m, 1e-9)), point)


def cloud_of(trajectory: Trajectory, sightings: CloudSightings) -> Float[np.ndarray, "m 3"]:
    """The points in the trajectory's map: pose ∘ point in the body frame.

    Raises:
        InputError: the trajectory has fewer poses than the sightings name.
    """
    if len(sightings) and sightings.pose_index.max() >= len(trajectory):
        raise InputError(
            f"cloud sightings name pose {sightings.pose_index.max()}; the trajectory has {len(trajectory)}. Expected "
            "the session's own trajectory, or one corrected from it pose by pose."
        )
    attitude = Rotation.from_quat(trajectory.quat_wxyz[sightings.pose_index], scalar_first=True)
    return attitude.apply(sightings.point_body_m) + trajectory.position_m[sightings.pose_index]


def _facade_foot_m(share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 2"]:
    """Places along the rectangle round the site."""
    low = SURVEYED_ENH_M[:, :2].min(axis=0) - FACADE_AWAY_M
    high = SURVEYED_ENH_M[:, :2].max(axis=0) + FACADE_AWAY_M
    corner = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corner, axis=0), axis=1))])
    at_m = share * along_m[-1]
    return np.column_stack([np.interp(at_m, along_m, axis) for axis in corner.T])
