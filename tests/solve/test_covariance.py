"""Posterior covariances against GTSAM's marginals and against the dense normal equations."""

import equinox as eqx
import gtsam
import jax.numpy as jnp
import numpy as np
import pytest
from solve.chain_session import graph_of, real_poses, session
from solve.dense_oracle import dense_covariance, dense_system
from solve.gtsam_peer import gtsam_graph, gtsam_values
from solve.programs import EVERYTHING, covariances, optimum, session_of_everything

from jaxgeo.geometry import hat
from jaxgeo.graph.pose_graph import PoseGraph, Terms
from jaxgeo.solve.linearise import globals_variance

N, K = 100, 7


def relative_difference(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of any entry, in units of the two standard deviations it belongs to."""
    sigma = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
    return float(np.max(np.abs(found - expected) / (sigma[..., :, None] * sigma[..., None, :])))


def gtsam_covariances(graph: PoseGraph) -> np.ndarray:
    """GTSAM's (rotation, translation) in body axes, turned into (position added, rotation on the left) in grid axes."""
    marginals = gtsam.Marginals(gtsam_graph(graph, N, K), gtsam_values(graph, N))
    rotation = real_poses(graph.base, N).rotation.as_matrix()
    turn = np.zeros((N, 6, 6))
    turn[:, :3, 3:] = turn[:, 3:, :3] = rotation
    body = np.stack([marginals.marginalCovariance(i) for i in range(N)])
    return turn @ body @ np.swapaxes(turn, 1, 2)


@pytest.mark.parametrize("rotation", [False, True])
def test_marginals_of_gtsam_where_nothing_is_wrong(rotation):
    """Without errors GTSAM's Jacobians are exact; with them it leaves out the logarithm's."""
    graph = graph_of(session(N, K, lever_m=1.0, sigma_rot_rad=0.02, error_size=0.0), Terms(rotation=True))
    if not rotation:
        nothing = jnp.zeros_like(graph.anchors.sqrt_information_rotation)
        graph = eqx.tree_at(lambda g: g.anchors.sqrt_information_rotation, graph, nothing)
    found, _ = covariances(graph)
    assert relative_difference(np.asarray(found)[:N], gtsam_covariances(graph)) < 1e-6


def dense_pose_covariances(graph: PoseGraph) -> tuple[np.ndarray, np.ndarray]:
    """Of every pose in the same terms, and of the globals."""
    _, jacobian = dense_system(graph, N)
    whole = dense_covariance(jacobian, N)
    position = real_poses(graph.base, N).translation
    found = np.empty((N, 6, 6))
    for i, p in enumerate(position):
        shift = np.eye(6)
        shift[:3, 3:] = -np.asarray(hat(jnp.asarray(p)))
        own = slice(6 * i, 6 * i + 6)
        found[i] = shift @ whole[own, own] @ shift.T
    return found, whole[6 * N :, 6 * N :]


def test_dense_normal_equations_with_noise():
    graph = optimum(graph_of(session_of_everything(N), EVERYTHING))
    found, of_globals = covariances(graph)
    expected, expected_globals = dense_pose_covariances(graph)
    assert relative_difference(np.asarray(found)[:N], expected) < 1e-6
    assert relative_difference(np.asarray(of_globals), expected_globals) < 1e-6
    # Anchors told something about every global.
    assert np.all(np.diagonal(of_globals) < np.asarray(globals_variance(graph)))
