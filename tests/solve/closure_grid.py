"""A walk to and fro over a square grid, tied to its neighbouring lanes: a small graph with many closures."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from jaxgeo.data import RelativePoses

SIGMA_M, SIGMA_RAD = 0.05, 0.01


def closure_grid(side: int = 8, seed: int = 0) -> tuple[np.ndarray, np.ndarray, RelativePoses]:
    """Start positions and rotations (odometry summed up), and edges whose information is a full 6x6 matrix."""
    rng = np.random.default_rng(seed)
    cell = np.array([(i, j if i % 2 == 0 else side - 1 - j) for i in range(side) for j in range(side)])
    row = {tuple(c): k for k, c in enumerate(cell.tolist())}
    n = side * side
    true_m = np.column_stack([cell, 0.3 * np.sin(cell[:, 0])]).astype(float)
    true_rot = Rotation.from_rotvec(
        np.column_stack([np.zeros((n, 2)), 0.5 * np.pi * np.arange(n)]) + rng.normal(0, 0.3, (n, 3))
    )
    lanes = [(row[i, j], row[i + 1, j]) for i in range(side - 1) for j in range(side)]
    ties = [(k, k + 1) for k in range(n - 1)] + [(a, b) for a, b in lanes if b - a > 1]
    first, second = np.array(ties).T
    half = 0.3 * rng.normal(size=(len(ties), 6, 6)) + np.eye(6)
    scale = np.array([1 / SIGMA_M] * 3 + [1 / SIGMA_RAD] * 3)
    information = scale[:, None] * (half @ half.transpose(0, 2, 1)) * scale
    information = 0.5 * (information + information.transpose(0, 2, 1))
    noise = Rotation.from_rotvec(rng.normal(0, SIGMA_RAD, (len(ties), 3)))
    t = true_rot[first].inv().apply(true_m[second] - true_m[first]) + rng.normal(0, SIGMA_M, (len(ties), 3))
    relative = true_rot[first].inv() * true_rot[second] * noise
    edges = RelativePoses(first, second, t, relative.as_quat(scalar_first=True), information)
    position, rotation = [true_m[0]], [true_rot[0]]
    for k in range(n - 1):
        position.append(position[-1] + rotation[-1].apply(t[k]))
        rotation.append(rotation[-1] * relative[k])
    return np.array(position), Rotation.concatenate(rotation).as_quat(scalar_first=True), edges


def with_false_closures(edges: RelativePoses, rows: np.ndarray, seed: int = 0) -> RelativePoses:
    """Some edges with motions of a metre or so that have nothing to do with the poses, as confident as before."""
    rng = np.random.default_rng(seed)
    t_m, quat = edges.t_m.copy(), edges.quat_wxyz.copy()
    t_m[rows] = rng.normal(size=(len(rows), 3))
    quat[rows] = Rotation.random(len(rows), rng=rng).as_quat(scalar_first=True)
    return dataclasses.replace(edges, t_m=t_m, quat_wxyz=quat)
