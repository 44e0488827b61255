"""Small sessions for the estimator's tests: a known walk, the odometry of it, and anchors along it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of, poses_of
from jaxgeo.graph.noise import OdometryNoise, edge_variances, odometry_noise
from jaxgeo.graph.pose_graph import PoseGraph, Terms
from jaxgeo.solve.adjoint import rebased
from jaxgeo.solve.fold import FoldOptions, fold_graph

NOISE = odometry_noise([0.02, 0.03, 0.025], [0.003, 0.002, 0.004], 0.003)
# Where a session lies in its local frame: not at its origin, and turned against the map.
GRID_FROM_MAP = RigidTransform.from_components([431.0, -187.0, 52.0], Rotation.from_euler("ZYX", [1.1, 0.05, -0.03]))


compiled_fold_graph = jax.jit(fold_graph, static_argnames="options")


@dataclasses.dataclass(frozen=True)
class Session:
    """The truth in the local frame, the trajectory as measured in its own map frame, anchors, and the noise drawn."""

    truth: Trajectory
    trajectory: Trajectory
    anchors: Anchors
    noise: OdometryNoise


def transforms(trajectory: Trajectory) -> RigidTransform:
    turn = Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)
    return RigidTransform.from_components(trajectory.position_m, turn)


def trajectory_of(poses: RigidTransform) -> Trajectory:
    n = len(poses)
    return Trajectory(np.arange(n) * 0.1, poses.translation, poses.rotation.as_quat(canonical=True, scalar_first=True))


def walk(n: int) -> RigidTransform:
    """A loop of three lobes, some 40 m wide, wandering in all six degrees of freedom."""
    a = np.linspace(0.0, 2.0 * np.pi, n)
    position = np.stack([20 * np.cos(a) + 5 * np.cos(5 * a), 14 * np.sin(a), 1.5 * np.sin(3 * a)], axis=1)
    yaw = np.unwrap(np.arctan2(np.gradient(position[:, 1]), np.gradient(position[:, 0])))
    attitude = Rotation.from_euler("ZYX", np.stack([yaw, 0.05 * np.sin(9 * a), 0.1 * np.cos(7 * a)], axis=1))
    return GRID_FROM_MAP * RigidTransform.from_components(position, attitude)


def drifted(truth: RigidTransform, noise: OdometryNoise, seed: int, size: float = 1.0) -> RigidTransform:
    """What odometry of that white noise (times `size`) makes of a motion, beginning at the map's origin."""
    step = truth[:-1].inv() * truth[1:]
    length = jnp.asarray(np.linalg.norm(step.translation, axis=1))
    trans, rot = edge_variances(noise, length, jnp.asarray(step.rotation.magnitude()))
    sigma = np.sqrt(np.stack([*rot, *trans], axis=1))
    missed = size * sigma * np.random.default_rng(seed).standard_normal(sigma.shape)
    return chained(step * RigidTransform.from_exp_coords(missed).inv())


def chained(step: RigidTransform) -> RigidTransform:
    matrix = np.empty((len(step) + 1, 4, 4))
    matrix[0] = np.eye(4)
    for k, one in enumerate(step.as_matrix()):
        matrix[k + 1] = matrix[k] @ one
    return RigidTransform.from_matrix(matrix)


def anchors_at(
    truth: RigidTransform,
    index: np.ndarray,
    seed: int = 0,
    *,
    lever_m: float = 0.0,
    sigma_m: float = 0.05,
    sigma_rot_rad: float | None = None,
    error_size: float = 1.0,
    location: tuple[str, ...] | None = None,
) -> Anchors:
    """Anchors on the true poses of `index`, their surveyed positions (and rotations) drawn with full covariances."""
    rng = np.random.default_rng([seed, len(index)])
    k = len(index)
    body = truth[index]
    lever = lever_m * rng.uniform(0.5, 1.5, (k, 3)) * rng.choice([-1.0, 1.0], (k, 3))
    survey = _covariances(rng, k, sigma_m)
    marker = body * RigidTransform.from_translation(lever)
    error = error_size * _drawn(rng, survey)
    seen, surveyed = np.full((k, 4), np.nan), np.full((k, 4), np.nan)
    rotation = np.zeros((k, 3, 3))
    if sigma_rot_rad is not None:
        rotation = _covariances(rng, k, sigma_rot_rad)
        turned = Rotation.from_rotvec(error_size * _drawn(rng, rotation))
        body_marker = Rotation.random(k, rng=rng)
        seen = body_marker.as_quat(scalar_first=True)
        surveyed = (body.rotation * turned * body_marker).as_quat(scalar_first=True)
    names = tuple(f"L{i}" for i in range(k)) if location is None else location
    order = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return Anchors(
        label=tuple(f"visit{i}" for i in range(k)),
        location=names,
        location_index=np.array([order[name] for name in names]),
        pose_index=np.asarray(index),
        lever_arm_m=lever,
        lever_covariance_m2=np.zeros((k, 3, 3)) if lever_m == 0 else _covariances(rng, k, 0.2 * sigma_m),
        surveyed_enh_m=marker.translation + error,
        survey_covariance_m2=survey,
        quat_body_marker_wxyz=seen,
        quat_grid_marker_wxyz=surveyed,
        rotation_covariance_rad2=rotation,
        repeatability_m=np.full(k, 0.01),
        count=np.full(k, 10),
        stamp_s=index * 0.1,
    )


def _covariances(rng: np.random.Generator, k: int, sigma: float) -> np.ndarray:
    """Not round: axes of 0.5 to 1.5 sigma, turned anyhow."""
    turn = Rotation.random(k, rng=rng).as_matrix()
    return np.einsum("kij,kj,klj->kil", turn, (sigma * rng.uniform(0.5, 1.5, (k, 3))) ** 2, turn)


def _drawn(rng: np.random.Generator, covariance: np.ndarray) -> np.ndarray:
    return np.einsum("kij,kj->ki", np.linalg.cholesky(covariance), rng.standard_normal(covariance.shape[:2]))


def session(n: int, k: int = 7, seed: int = 0, *, error_size: float = 1.0, **anchor_options) -> Session:
    """`n` poses, `k` anchors from first to last pose; `error_size` 0: nothing in it is wrong."""
    truth = walk(n)
    index = np.linspace(0, n - 1, k).astype(int)
    return Session(
        trajectory_of(truth),
        trajectory_of(drifted(truth, NOISE, seed, error_size)),
        anchors_at(truth, index, seed, error_size=error_size, **anchor_options),
        NOISE,
    )


def graph_of(made: Session, terms: Terms | None = None, loss_width: float = 3.0) -> PoseGraph:
    """The session's graph with all anchors, started at its coarse fit."""
    chain = chain_of(made.trajectory)
    table = anchor_table(made.anchors, chain)
    options = FoldOptions(terms=terms or Terms())
    return compiled_fold_graph(chain, table, made.noise, table.real, jnp.asarray(loss_width), options)[0]


def started_badly(graph: PoseGraph, n: int, seed: int, trans_m: float, rot_rad: float, turn_rad: float) -> PoseGraph:
    """Every pose moved and turned at random, then all of them about an upright axis, the odometry left as it was."""
    rng = np.random.default_rng(seed)
    poses = real_poses(graph.base, n)
    wrong = RigidTransform.from_components(
        trans_m * rng.standard_normal((n, 3)), Rotation.from_rotvec(rot_rad * rng.standard_normal((n, 3)))
    )
    moved = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, turn_rad])) * poses * wrong
    start = trajectory_of(moved)
    padded = graph.chain.length_m.shape[0]
    return rebased(graph, poses_of(start.position_m, start.quat_wxyz, padded), graph.base_globals)


def real_poses(poses, n: int) -> RigidTransform:
    """The unpadded poses."""
    quat = np.stack([np.asarray(c)[:n] for c in poses.quat], axis=1)
    position = np.stack([np.asarray(c)[:n] for c in poses.t], axis=1)
    return RigidTransform.from_components(position, Rotation.from_quat(quat, scalar_first=True))
