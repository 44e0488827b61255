"""A simulated session at the reference study's site: one marker, six surveyed locations, seven visits.

The layout is the study's; the walk, the drift and every error are drawn here. It shows that the software works, not how
well real odometry can be corrected.
"""

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform

from jaxgeo.data import Sightings, Survey, Trajectory
from jaxgeo.errors import InputError
from jaxgeo.graph.components import NoiseEnsemble
from jaxgeo.simulate.course import course_of
from jaxgeo.simulate.drift import Drift, drifting_poses
from jaxgeo.simulate.faults import Faults, faulty_order, faulty_survey
from jaxgeo.simulate.layout import CRS, LOCATIONS, ORDER, ORIGIN_ENH_M, SURVEYED_NEH_M, UAV, Layout
from jaxgeo.simulate.sightings import sightings_of
from jaxgeo.simulate.true_noise import true_noise

__all__ = ["LOCATIONS", "ORDER", "ORIGIN_ENH_M", "SURVEYED_NEH_M", "SimulatedSession", "simulate_session"]

START_S = 1_700_000_000.0
SURVEY_SIGMA_M = 0.01
# One constant error of the sightings of a visit, which their scatter does not show (calibration, pose bias).
VISIT_SIGMA_M = 0.03

# Streams of random numbers below the seed: the survey's, the sightings', and one a trajectory.
SURVEY_STREAM, SIGHTING_STREAM, FIRST_ODOMETRY_STREAM = 0, 1, 2

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
        layout: what was visited, when and from where.
        survey: as surveyed, grid coordinates, with the faults put into it.
        truth: poses `T_local_body`, local frame = grid (E, N, h) minus `ORIGIN_ENH_M`.
        trajectories: by name, each in a map frame of its own: the first pose.
        drift: what was wrong with each of them.
        sightings: in the body frame, ids unknown: one marker was moved.
        order: the location of each visit as it is told; with faults not that of the layout.
        marker_enh_m: true marker position by location, local frame: the surveyed one plus its error.
        faults: put into survey, order and stamps.
        visit_sigma_m: of the constant error of a visit's sightings.
    """

    seed: int
    layout: Layout
    survey: Survey
    truth: Trajectory
    trajectories: dict[str, Trajectory]
    drift: dict[str, Drift]
    sightings: Sightings
    order: tuple[str, ...]
    marker_enh_m: dict[str, np.ndarray]
    faults: Faults
    visit_sigma_m: float

    def true_noise(self, name: str) -> NoiseEnsemble:
        """The noise that trajectory `name` was drawn from, per metre of its own length: `true_noise.true_noise`."""
        return true_noise(self.trajectories[name], self.truth, self.drift[name])


def simulate_session(
    seed: int = 0,
    layout: Layout = UAV,
    *,
    drift: dict[str, Drift] | None = None,
    faults: Faults | None = None,
    survey_sigma_m: float = SURVEY_SIGMA_M,
    visit_sigma_m: float = VISIT_SIGMA_M,
    sighting_noise: float = 1.0,
) -> SimulatedSession:
    """Simulate the session; the same arguments give the same numbers, bit for bit.

    Args:
        seed: every source of error draws from a stream of its own, so that changing one leaves the others alone.
            Layouts under one seed have the survey's error in common: one site, surveyed once.
        layout: `UAV`, `UGV`, or one's own.
        drift: by trajectory name; default a mild `icp` and a milder `dense`; the study's sizes: `paper_drift`.
        faults: put into the inputs; default none.
        survey_sigma_m: of the surveyed coordinates, each axis.
        visit_sigma_m: constant error of a visit's sightings, each axis.
        sighting_noise: factor on the layout's repeatability, and on the rotation noise.

    Raises:
        InputError: a fault, a closure or a `draws_of` that names what the session does not have.
    """
    drift = {"icp": ICP_DRIFT, "dense": DENSE_DRIFT} if drift is None else drift
    faults = Faults() if faults is None else faults
    course = course_of(layout)
    survey_random = np.random.default_rng(_stream(seed, 0, SURVEY_STREAM))
    true_m = SURVEYED_NEH_M[:, [1, 0, 2]] - ORIGIN_ENH_M
    true_m = true_m + survey_sigma_m * survey_random.standard_normal((len(LOCATIONS), 3))
    marker_enh_m: dict[str, np.ndarray] = dict(zip(LOCATIONS, true_m, strict=True))
    sightings = sightings_of(
        course.walk,
        layout,
        np.array([marker_enh_m[name] for name in layout.order]),
        visit_sigma_m,
        sighting_noise,
        np.random.default_rng(_stream(seed, layout.stream, SIGHTING_STREAM)),
    )
    stream = {name: _stream(seed, layout.stream, FIRST_ODOMETRY_STREAM + i) for i, name in enumerate(drift)}
    stamp_s = START_S + course.stamp_s
    trajectories = {}
    for name, wrong in drift.items():
        source = wrong.draws_of or name
        if source not in stream:
            raise InputError(
                f"drift of {name!r}: draws_of names {source!r}; the session has {', '.join(drift)}. Simulate it beside "
                "that one, or leave draws_of empty."
            )
        trajectories[name] = _trajectory(stamp_s, drifting_poses(course, wrong, stream[source], stream[name]))
    return SimulatedSession(
        seed=seed,
        layout=layout,
        survey=faulty_survey(_survey(survey_sigma_m), faults),
        truth=_trajectory(stamp_s, course.pose),
        trajectories=trajectories,
        drift=drift,
        sightings=dataclasses.replace(sightings, stamp_s=START_S + faults.time_offset_s + sightings.stamp_s),
        order=faulty_order(layout, faults),
        marker_enh_m=marker_enh_m,
        faults=faults,
        visit_sigma_m=visit_sigma_m,
    )


def _stream(seed: int, layout: int, source: int) -> np.random.SeedSequence:
    return np.random.SeedSequence([seed, layout], spawn_key=(source,))


def _trajectory(stamp_s: np.ndarray, poses: RigidTransform) -> Trajectory:
    return Trajectory(stamp_s, poses.translation, poses.rotation.as_quat(canonical=True, scalar_first=True))


def _survey(sigma_m: float) -> Survey:
    unknown = np.full((len(LOCATIONS), 3), np.nan)
    return Survey(
        name=LOCATIONS,
        enh_m=SURVEYED_NEH_M[:, [1, 0, 2]],
        sigma_m=np.full((len(LOCATIONS), 3), sigma_m),
        quat_grid_marker_wxyz=np.full((len(LOCATIONS), 4), np.nan),
        sigma_rot_rad=unknown,
        crs=CRS,
    )
