"""A simulated session of the reference study's layout: one marker, six surveyed locations, seven visits.

Locations, visiting order, sighting counts, repeatability and the length of the session are the study's (its first
session); the walk, the drift and every error are drawn here. It shows that the software works, not how well real
odometry can be corrected.
"""

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Sightings, Survey, Trajectory
from jaxgeo.simulate.drift import Drift, chain, drifting_steps
from jaxgeo.simulate.walk import Walk, walk_past

CRS = "EPSG:2169"
LOCATIONS: tuple[str, ...] = ("A", "B", "C", "D", "E", "F")
SURVEYED_NEH_M = np.array(
    [
        [76839.129, 79345.498, 340.570],
        [76829.898, 79357.502, 339.409],
        [76821.262, 79363.262, 338.276],
        [76789.028, 79320.063, 338.382],
        [76804.525, 79309.431, 340.234],
        [76815.709, 79296.809, 341.129],
    ]
)
ORDER = ("A", "B", "C", "D", "E", "F", "A")
COUNTS = (152, 289, 167, 209, 197, 185, 175)
REPEATABILITY_M = (0.1471, 0.2254, 0.1094, 0.0603, 0.1821, 0.1443, 0.0794)
ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])

N_POSES = 1829
DURATION_S = 320.0
IMAGE_RATE_HZ = 10.0
START_S = 1_700_000_000.0
SURVEY_SIGMA_M = 0.01
SIGHTING_SIGMA_ROT_RAD = 0.03
# One constant error of the sightings of a visit, which their scatter does not show (calibration, pose bias).
VISIT_SIGMA_M = 0.03

# Frame-to-model odometry that drifts one way, and a mapping run that drifts less; both metric.
ICP_DRIFT = Drift(
    sigma_trans_m_per_sqrt_m=(0.02, 0.02, 0.02),
    sigma_rot_rad_per_sqrt_m=(0.002, 0.002, 0.002),
    sigma_turn_rad_per_sqrt_rad=0.002,
    bias_trans_m_per_m=(0.006, 0.0, 0.01),
    bias_rot_rad_per_m=(0.0, 0.0003, 0.0008),
)
DENSE_DRIFT = Drift(
    sigma_trans_m_per_sqrt_m=(0.01, 0.01, 0.01),
    sigma_rot_rad_per_sqrt_m=(0.001, 0.001, 0.001),
    sigma_turn_rad_per_sqrt_rad=0.001,
    bias_trans_m_per_m=(0.002, 0.0, 0.002),
    bias_rot_rad_per_m=(0.0, 0.0001, 0.0002),
)


@dataclasses.dataclass(frozen=True)
class SimulatedSession:
    """A session and its truth.

    Attributes:
        seed: of all its random numbers.
        survey: as surveyed, grid coordinates.
        truth: poses `T_local_body`, local frame = grid (E, N, h) minus `ORIGIN_ENH_M`.
        trajectories: by name, each in a map frame of its own: the first pose.
        drift: what was wrong with each of them.
        sightings: in the body frame, ids unknown: one marker was moved.
        marker_enh_m: true marker position by location, local frame: the surveyed one plus its error.
    """

    seed: int
    survey: Survey
    truth: Trajectory
    trajectories: dict[str, Trajectory]
    drift: dict[str, Drift]
    sightings: Sightings
    marker_enh_m: dict[str, np.ndarray]


def simulate_session(
    seed: int = 0,
    *,
    drift: dict[str, Drift] | None = None,
    survey_sigma_m: float = SURVEY_SIGMA_M,
    visit_sigma_m: float = VISIT_SIGMA_M,
    sighting_noise: float = 1.0,
) -> SimulatedSession:
    """Simulate the session; the same seed gives the same numbers, bit for bit.

    Args:
        seed: every source of error draws from a stream of its own, so that changing one leaves the others alone.
        drift: by trajectory name; default `icp` and `dense`.
        survey_sigma_m: of the surveyed coordinates, each axis.
        visit_sigma_m: constant error of a visit's sightings, each axis.
        sighting_noise: factor on the study's repeatability, and on the rotation noise.
    """
    drift = {"icp": ICP_DRIFT, "dense": DENSE_DRIFT} if drift is None else drift
    survey_random, sighting_random, *odometry_random = (
        np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2 + len(drift))
    )
    surveyed_m = SURVEYED_NEH_M[:, [1, 0, 2]]
    true_m = surveyed_m - ORIGIN_ENH_M + survey_sigma_m * survey_random.standard_normal((len(LOCATIONS), 3))
    marker_enh_m: dict[str, np.ndarray] = dict(zip(LOCATIONS, true_m, strict=True))
    visited_m = np.array([marker_enh_m[name] for name in ORDER])
    walk = walk_past(visited_m, np.array(COUNTS) / IMAGE_RATE_HZ, DURATION_S)

    stamp_s = np.linspace(0.0, DURATION_S, N_POSES)
    pose = walk.pose(stamp_s)
    trajectories = {
        name: Trajectory(START_S + stamp_s, *chain(drifting_steps(pose, wrong, random)))
        for (name, wrong), random in zip(drift.items(), odometry_random, strict=True)
    }
    return SimulatedSession(
        seed=seed,
        survey=_survey(surveyed_m, survey_sigma_m),
        truth=Trajectory(START_S + stamp_s, pose.translation, pose.rotation.as_quat(canonical=True, scalar_first=True)),
        trajectories=trajectories,
        drift=drift,
        sightings=_sightings(walk, visited_m, visit_sigma_m, sighting_noise, sighting_random),
        marker_enh_m=marker_enh_m,
    )


def _survey(surveyed_m: np.ndarray, sigma_m: float) -> Survey:
    unknown = np.full((len(LOCATIONS), 3), np.nan)
    return Survey(
        name=LOCATIONS,
        enh_m=surveyed_m,
        sigma_m=np.full((len(LOCATIONS), 3), sigma_m),
        quat_grid_marker_wxyz=np.full((len(LOCATIONS), 4), np.nan),
        sigma_rot_rad=unknown,
        crs=CRS,
    )


def _sightings(
    walk: Walk, visited_m: np.ndarray, visit_sigma_m: float, noise: float, random: np.random.Generator
) -> Sightings:
    """Every visit's sightings at the image rate, with the study's scatter and one constant error a visit."""
    stamps, positions, attitudes, sigmas = [], [], [], []
    for visit, (count, scatter_m) in enumerate(zip(COUNTS, REPEATABILITY_M, strict=True)):
        stamp_s = walk.arrive_s[visit] + (np.arange(count) + random.uniform(0.2, 0.8, count)) / IMAGE_RATE_HZ
        body = walk.pose(stamp_s)
        facing = np.arctan2(*(body.translation.mean(axis=0) - visited_m[visit])[[1, 0]])
        # The marker's z axis points at whoever looks at it, its y axis up.
        marker = RigidTransform.from_components(
            visited_m[visit], Rotation.from_euler("ZY", [facing, np.pi / 2]) * Rotation.from_euler("z", np.pi / 2)
        )
        seen = body.inv() * marker
        # Repeatability is the length of the error vector: three axes.
        sigma_m = noise * scatter_m / np.sqrt(3)
        constant_m = visit_sigma_m * random.standard_normal(3)
        positions.append(seen.translation + constant_m + sigma_m * random.standard_normal((count, 3)))
        turned = Rotation.from_rotvec(noise * SIGHTING_SIGMA_ROT_RAD * random.standard_normal((count, 3)))
        attitudes.append((turned * seen.rotation).as_quat(canonical=True, scalar_first=True))
        stamps.append(START_S + stamp_s)
        sigmas.append(np.full(count, sigma_m))
    n = sum(COUNTS)
    covariance = np.zeros((n, 6, 6))
    # Noise-free sightings still need a covariance that can be inverted.
    sigma = np.maximum(np.concatenate(sigmas), 1e-4)
    covariance[:, [0, 1, 2], [0, 1, 2]] = sigma[:, None] ** 2
    covariance[:, [3, 4, 5], [3, 4, 5]] = max(noise * SIGHTING_SIGMA_ROT_RAD, 1e-4) ** 2
    return Sightings(
        stamp_s=np.concatenate(stamps),
        marker=np.full(n, ""),
        t_body_marker_m=np.concatenate(positions),
        quat_body_marker_wxyz=np.concatenate(attitudes),
        covariance=covariance,
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"simulated:{row + 1}" for row in range(n)]),
    )
