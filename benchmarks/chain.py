"""The benchmark's problem: a noisy pose chain round and round one loop, with position anchors."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.graph.anchor_table import anchor_table
from jaxgeo.graph.chain import chain_of
from jaxgeo.graph.noise import LENGTH_FLOOR_M, OdometryNoise, edge_variances, odometry_noise
from jaxgeo.graph.pose_graph import PoseGraph, Terms
from jaxgeo.solve.fold import FoldOptions, fold_graph

# The paper's session: one loop in so many poses. A longer chain goes on at the same pace.
POSES_PER_LAP = 1829
ANCHOR_SIGMA_M = 0.1
# About 1 cm and 2 mrad for each edge of 16 cm.
WHITE = odometry_noise(0.025, 0.005, 0.002)
# Good LiDAR odometry. A million poses are 160 km: with the noise above, their heading would be lost by two radians.
LIDAR = odometry_noise(0.01, 0.002)
# `WHITE`, and every other parameter of the noise model in use.
FULL = odometry_noise(0.025, 0.005, 0.002, 0.02, 1e-3, 1e-4)
FULL_TERMS = Terms(log_scale=True, bias=True)


def chain_graph(n: int, k: int, seed: int = 0, noise: OdometryNoise = WHITE, terms: Terms | None = None) -> PoseGraph:
    """The graph of n poses and k anchors, the first on pose 0, the last on pose n-1, started at its coarse fit.

    The white part of `noise` is what is drawn.
    """
    rng = np.random.default_rng(seed)
    truth = walk(n)
    trajectory = drifted(truth, noise, rng)
    index = np.linspace(0, n - 1, k).astype(int)
    chain = chain_of(trajectory)
    table = anchor_table(_anchors(truth, index, rng), chain)
    options = FoldOptions(terms=terms or Terms())
    return fold_graph(chain, table, noise, table.real, jnp.asarray(3.0), options)[0]


def walk(n: int) -> RigidTransform:
    """n true poses along a loop some 80 m long and 50 m wide, moving in all six degrees of freedom."""
    a = 2.0 * np.pi / (POSES_PER_LAP - 1) * np.arange(n)
    position = np.stack([40 * np.cos(a) + 5 * np.cos(5 * a), 25 * np.sin(a), 1.5 * np.sin(3 * a)], axis=1)
    yaw = np.arctan2(25 * np.cos(a), -40 * np.sin(a) - 25 * np.sin(5 * a))
    attitude = Rotation.from_euler("ZYX", np.stack([yaw, 0.05 * np.sin(9 * a), 0.03 * np.cos(7 * a)], axis=1))
    return RigidTransform.from_components(position, attitude)


def drifted(truth: RigidTransform, noise: OdometryNoise, rng: np.random.Generator) -> Trajectory:
    """What odometry with that white noise makes of a motion, from its true first pose."""
    step = truth[:-1].inv() * truth[1:]
    length = jnp.asarray(np.linalg.norm(step.translation, axis=1) + LENGTH_FLOOR_M)
    trans, rot = edge_variances(noise, length, jnp.asarray(step.rotation.magnitude()))
    missed = np.sqrt(np.stack([*rot, *trans], axis=1)) * rng.standard_normal((len(step), 6))
    measured = step * RigidTransform.from_exp_coords(missed)
    pose = RigidTransform.from_matrix(composed(truth[0].as_matrix(), measured.as_matrix()))
    stamp_s = 0.1 * np.arange(len(pose))
    return Trajectory(stamp_s, pose.translation, pose.rotation.as_quat(canonical=True, scalar_first=True))


def composed(first: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(n+1, 4, 4) running products of a first pose and n steps: sqrt(n) blocks side by side, then block after block."""
    n = len(step)
    width = int(np.ceil(np.sqrt(n)))
    blocks = -(-n // width)
    padded = np.broadcast_to(np.eye(4), (blocks * width, 4, 4)).copy()
    padded[:n] = step
    inside = padded.reshape(blocks, width, 4, 4)
    for j in range(1, width):
        inside[:, j] = inside[:, j - 1] @ inside[:, j]
    before = np.empty((blocks, 1, 4, 4))
    before[0] = first
    for b in range(1, blocks):
        before[b] = before[b - 1] @ inside[b - 1, -1]
    return np.concatenate([first[None], (before @ inside).reshape(-1, 4, 4)[:n]])


def _anchors(truth: RigidTransform, index: np.ndarray, rng: np.random.Generator) -> Anchors:
    k = len(index)
    unknown = np.full((k, 4), np.nan)
    return Anchors(
        label=tuple(f"visit{j}" for j in range(k)),
        location=tuple(f"L{j}" for j in range(k)),
        location_index=np.arange(k),
        pose_index=index,
        lever_arm_m=np.zeros((k, 3)),
        lever_covariance_m2=np.zeros((k, 3, 3)),
        surveyed_enh_m=truth[index].translation + rng.normal(0.0, ANCHOR_SIGMA_M, (k, 3)),
        survey_covariance_m2=np.broadcast_to(ANCHOR_SIGMA_M**2 * np.eye(3), (k, 3, 3)),
        quat_body_marker_wxyz=unknown,
        quat_grid_marker_wxyz=unknown,
        rotation_covariance_rad2=np.zeros((k, 3, 3)),
        repeatability_m=np.zeros(k),
        count=np.ones(k, dtype=int),
        stamp_s=0.1 * index,
    )
