"""The same graph in GTSAM, and its solve. GTSAM's tangents are (rotation, translation)."""

from collections.abc import Iterable

import gtsam
import numpy as np

from benchmarks.chain import ANCHOR_SIGMA_M
from jaxgeo.graph.noise import edge_variances
from jaxgeo.graph.pose_graph import PoseGraph


class Peer:
    """GTSAM's factors and start values of a benchmark graph, n poses; only the anchors named in `used`."""

    def __init__(self, graph: PoseGraph, n: int, used: Iterable[int]) -> None:
        chain, anchors = graph.chain, graph.anchors
        trans, rot = edge_variances(graph.noise, chain.length_m, chain.turn_rad)
        sigma = np.sqrt(_columns((*rot, *trans), n))
        self._factors = gtsam.NonlinearFactorGraph()
        odometry = _poses(chain.odometry, n)
        for i in range(1, n):
            model = gtsam.noiseModel.Diagonal.Sigmas(sigma[i])
            self._factors.add(gtsam.BetweenFactorPose3(i - 1, i, odometry[i], model))
        model = gtsam.noiseModel.Isotropic.Sigma(3, ANCHOR_SIGMA_M)
        index, measured = np.asarray(anchors.pose_index), np.asarray(anchors.measured_m)
        for j in used:
            self._factors.add(gtsam.GPSFactor(int(index[j]), measured[j], model))
        self._start = gtsam.Values()
        for i, pose in enumerate(_poses(graph.base, n)):
            self._start.insert(i, pose)

    def solve(self) -> tuple[float, int]:
        """Cost at the optimum, and iterations; to the tolerances that our solver has."""
        settings = gtsam.LevenbergMarquardtParams()
        settings.setRelativeErrorTol(1e-9)
        settings.setAbsoluteErrorTol(1e-12)
        optimizer = gtsam.LevenbergMarquardtOptimizer(self._factors, self._start, settings)
        optimizer.optimize()
        return optimizer.error(), optimizer.iterations()


def _columns(parts, n: int) -> np.ndarray:
    return np.stack([np.asarray(c)[:n] for c in parts], axis=1)


def _poses(poses, n: int) -> list[gtsam.Pose3]:
    quat, position = _columns(poses.quat, n), _columns(poses.t, n)
    return [gtsam.Pose3(gtsam.Rot3.Quaternion(*q), p) for q, p in zip(quat, position, strict=True)]
