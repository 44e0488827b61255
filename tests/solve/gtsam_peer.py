"""The same pose graph in GTSAM, whose tangents are rotation first."""

import gtsam
import numpy as np

from jaxgeo.graph.chain import poses_of
from jaxgeo.graph.noise import edge_variances
from jaxgeo.graph.pose_graph import PoseGraph, chain_noise, cost_at


def pose3(quat_wxyz: np.ndarray, position: np.ndarray) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Quaternion(*quat_wxyz), position)


def columns(parts, n: int) -> np.ndarray:
    return np.stack([np.asarray(c)[:n] for c in parts], axis=1)


def gtsam_graph(graph: PoseGraph, n: int, k: int) -> gtsam.NonlinearFactorGraph:
    """White odometry noise and anchors; no globals, no robust loss."""
    found = gtsam.NonlinearFactorGraph()
    trans, rot = edge_variances(graph.noise, graph.chain.length_m, graph.chain.turn_rad)
    sigma = np.sqrt(columns((*rot, *trans), n))
    quat, step = columns(graph.chain.odometry.quat, n), columns(graph.chain.odometry.t, n)
    for i in range(1, n):
        model = gtsam.noiseModel.Diagonal.Sigmas(sigma[i])
        found.add(gtsam.BetweenFactorPose3(i - 1, i, pose3(quat[i], step[i]), model))
    a = graph.anchors
    for j in range(k):
        key, weight = int(a.pose_index[j]), np.asarray(a.sqrt_information[j])
        model = gtsam.noiseModel.Gaussian.Information(weight.T @ weight)
        if np.any(np.asarray(a.lever_arm_m[j])):
            found.add(gtsam.GPSFactorArm(key, np.asarray(a.measured_m[j]), np.asarray(a.lever_arm_m[j]), model))
        else:
            found.add(gtsam.GPSFactor(key, np.asarray(a.measured_m[j]), model))
        weight = np.asarray(a.sqrt_information_rotation[j])
        if np.any(weight):
            model = gtsam.noiseModel.Gaussian.Information(weight.T @ weight)
            found.add(gtsam.PoseRotationPrior3D(key, gtsam.Rot3(np.asarray(a.measured_rotation[j])), model))
    return found


def gtsam_values(graph: PoseGraph, n: int) -> gtsam.Values:
    values = gtsam.Values()
    for i, (quat, position) in enumerate(zip(columns(graph.base.quat, n), columns(graph.base.t, n), strict=True)):
        values.insert(i, pose3(quat, position))
    return values


def gtsam_solve(factors: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> gtsam.Values:
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-14)
    settings.setAbsoluteErrorTol(1e-14)
    settings.setMaxIterations(200)
    return gtsam.LevenbergMarquardtOptimizer(factors, start, settings).optimize()


def cost_of_values(values: gtsam.Values, graph: PoseGraph, n: int) -> float:
    """Our own cost at GTSAM's poses."""
    poses = [values.atPose3(i) for i in range(n)]
    quat = np.array([p.rotation().toQuaternion().coeffs()[[3, 0, 1, 2]] for p in poses])
    position = np.array([p.translation() for p in poses])
    padded = poses_of(position, quat, graph.chain.length_m.shape[0])
    return float(cost_at(padded, graph.base_globals, chain_noise(padded, graph.base_globals, graph), graph))
