"""A made-up SessionResult on the layout of the reference study: right in shape and size, solved by nobody."""

import dataclasses

import numpy as np
from export.synthetic_learned import drift_curves, learned_noise
from scipy.spatial.transform import Rotation

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.export.result import CoarseFit, HeldOut, ReferenceError, SessionResult, TrajectoryResult
from jaxgeo.georef import LocalFrame

SURVEY_ENH_M = {
    "A": (79345.498, 76839.129, 340.570),
    "B": (79357.502, 76829.898, 339.409),
    "C": (79363.262, 76821.262, 338.276),
    "D": (79320.063, 76789.028, 338.382),
    "E": (79309.431, 76804.525, 340.234),
    "F": (79296.809, 76815.709, 341.129),
}
ORIGIN_ENH_M = np.array([79300.0, 76800.0, 300.0])
ORDER = "ABCDEFA"


def luref_session(n_poses: int = 1829, simulated: bool = True) -> SessionResult:
    """Two trajectories in EPSG:2169: `icp` with all stages, `dense` with fixed noise only and no reference."""
    survey = {name: np.array(p) - ORIGIN_ENH_M for name, p in SURVEY_ENH_M.items()}
    icp = trajectory_result("icp", survey, n_poses, drift=1.0, seed=1)
    dense = trajectory_result("dense", survey, n_poses // 2, drift=0.2, seed=2)
    dense = dataclasses.replace(
        dense,
        held_out={k: v for k, v in dense.held_out.items() if k != "learned"},
        reference={},
        warnings=(),
        noise={"fixed": dense.noise["fixed"]},
        drift_growth=None,
    )
    return session("luref_walk", LocalFrame.create("EPSG:2169", ORIGIN_ENH_M), survey, [icp, dense], simulated)


def local_session(n_poses: int = 400) -> SessionResult:
    """One trajectory in a site frame without a datum."""
    survey = {name: np.array(p) - ORIGIN_ENH_M for name, p in SURVEY_ENH_M.items()}
    result = trajectory_result("vio", survey, n_poses, drift=0.3, seed=3)
    return session("site_walk", LocalFrame.create("local", np.zeros(3)), survey, [result], simulated=False)


def session(name: str, frame: LocalFrame, survey: dict, trajectories: list, simulated: bool) -> SessionResult:
    return SessionResult(
        name=name,
        frame=frame,
        survey_enh_m=survey,
        trajectories={t.name: t for t in trajectories},
        config={"name": name, "crs": frame.crs, "seed": 7, "noise": {"mode": "learned"}, "simulated": simulated},
        run={
            "versions": {"jaxgeo": "0.1.0", "jax": "0.10.2", "python": "3.11.2"},
            "input_sha256": {"survey.csv": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"},
            "seed": 7,
            "timing_s": {"read": 0.12, "total": 3.4},
        },
        simulated=simulated,
    )


def trajectory_result(name: str, survey: dict, n_poses: int, drift: float, seed: int) -> TrajectoryResult:
    """A walk through the visiting order; errors drawn from the covariances that are claimed for them."""
    rng = np.random.default_rng(seed)
    stop = np.array([survey[location] for location in ORDER])
    pose_index = np.linspace(0.03, 0.97, len(ORDER)) * (n_poses - 1)
    pose_index = pose_index.round().astype(int)
    row = np.arange(n_poses)
    position_m = np.column_stack([np.interp(row, pose_index, stop[:, i]) for i in range(3)])
    position_m[:, :2] += 2.0 * np.column_stack([np.sin(row / n_poses * 40), np.cos(row / n_poses * 31)])
    yaw = np.unwrap(np.arctan2(np.gradient(position_m[:, 1]), np.gradient(position_m[:, 0])))
    quat_wxyz = Rotation.from_euler("z", yaw[:, None]).as_quat()[:, [3, 0, 1, 2]]
    stamp_s = 1.7e9 + 0.2 * row
    growth = np.abs(row[:, None] - pose_index).min(axis=1) / n_poses * len(ORDER)
    covariance = covariances(0.01 + 0.4 * drift * growth)
    wander = np.cumsum(rng.normal(0.0, 2.0 * drift / np.sqrt(n_poses), (n_poses, 3)), axis=0)
    corrected = Trajectory(stamp_s, position_m, quat_wxyz)
    coarse = Trajectory(stamp_s, position_m + wander - wander.mean(axis=0), quat_wxyz)
    anchors = make_anchors(corrected, pose_index, stop, rng)
    residual_coarse_m = coarse.position_m[pose_index] - position_m[pose_index]
    return TrajectoryResult(
        name=name,
        measured=Trajectory(stamp_s, coarse.position_m - stop[0], quat_wxyz),
        coarse=CoarseFit(1.0 + 0.003 * drift, np.eye(3), stop[0], rms(residual_coarse_m)),
        coarse_trajectory=coarse,
        corrected=corrected,
        covariance=covariance,
        anchors=anchors,
        residual_coarse_m=residual_coarse_m,
        residual_refined_m=rng.normal(0.0, 0.01, (len(ORDER), 3)),
        held_out=make_held_out(rng, residual_coarse_m, drift),
        revisit={"A": {"coarse_m": 2.24 * drift, "refined_m": 0.031 * drift, "held_out_m": 0.47 * drift}},
        reference={s: make_reference(rng, stamp_s, scale) for s, scale in zip(STAGES, (0.8, 0.2, 0.15), strict=True)},
        noise={"fixed": {"sigma_trans": 0.02, "sigma_rot": 0.003}, "learned": learned_noise()},
        log_scale=(0.0031, 0.0008),
        solver={"result": "converged", "steps": 5, "cost": 12.345},
        timing_s={"coarse": 0.01, "graph": 0.21, "leave_one_out": 0.4},
        warnings=("2 sightings lay outside the trajectory's time & were left out",),
        drift_growth=drift_curves(),
    )


STAGES = ("coarse", "fixed", "learned")


def make_anchors(trajectory: Trajectory, pose_index: np.ndarray, stop: np.ndarray, rng: np.random.Generator) -> Anchors:
    """Seven visits, the last one a revisit of A."""
    k = len(ORDER)
    rotation = Rotation.from_quat(trajectory.quat_wxyz[pose_index], scalar_first=True)
    nothing = np.full((k, 4), np.nan)
    return Anchors(
        label=(*ORDER[:-1], "A_revisit"),
        location=tuple(ORDER),
        location_index=np.array([ORDER.index(c) for c in ORDER]),
        pose_index=pose_index,
        lever_arm_m=rotation.inv().apply(stop - trajectory.position_m[pose_index]),
        lever_covariance_m2=np.tile(1e-4 * np.eye(3), (k, 1, 1)),
        surveyed_enh_m=stop,
        survey_covariance_m2=np.tile(np.diag([1e-4, 1e-4, 4e-4]), (k, 1, 1)),
        quat_body_marker_wxyz=nothing,
        quat_grid_marker_wxyz=nothing,
        rotation_covariance_rad2=np.zeros((k, 3, 3)),
        repeatability_m=rng.uniform(0.05, 0.2, k),
        count=rng.integers(80, 290, k),
        stamp_s=trajectory.stamp_s[pose_index],
    )


def make_held_out(rng: np.random.Generator, residual_coarse_m: np.ndarray, drift: float) -> dict[str, HeldOut]:
    """Coarse without covariance; fixed and learned drawn from a correlated covariance; the last fixed fold failed."""
    k = len(residual_coarse_m)
    stages = {"coarse": HeldOut(1.3 * residual_coarse_m, np.full((k, 3, 3), np.nan), ("closed form",) * k)}
    for stage, size in (("fixed", 0.35), ("learned", 0.25)):
        factor = size * drift * np.array([[1.0, 0.0, 0.0], [0.6, 0.5, 0.0], [0.1, 0.0, 0.3]])
        error = rng.normal(size=(k, 3)) @ factor.T
        stages[stage] = HeldOut(error, np.tile(factor @ factor.T, (k, 1, 1)), ("converged",) * k)
    fixed = stages["fixed"]
    error = fixed.error_enh_m.copy()
    error[3] = np.nan
    stages["fixed"] = HeldOut(error, fixed.covariance_m2, ("converged",) * 3 + ("not determined",) + ("converged",) * 3)
    return stages


def make_reference(rng: np.random.Generator, stamp_s: np.ndarray, scale: float) -> ReferenceError:
    error = np.abs(rng.normal(0.0, scale, len(stamp_s)))
    return ReferenceError(float(np.sqrt(np.mean(error**2))), float(np.median(error)), len(stamp_s), error, stamp_s)


def covariances(sigma_m: np.ndarray) -> np.ndarray:
    """(n, 6, 6), east and north correlated."""
    block = np.array([[1.0, 0.4, 0.0], [0.4, 0.6, 0.0], [0.0, 0.0, 0.25]])
    covariance = np.zeros((len(sigma_m), 6, 6))
    covariance[:, :3, :3] = sigma_m[:, None, None] ** 2 * block
    covariance[:, 3:, 3:] = (0.01 * sigma_m[:, None, None]) ** 2 * np.eye(3)
    return covariance


def rms(error_m: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(error_m**2, axis=1))))
