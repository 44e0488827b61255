"""Odometry and closures in one graph."""

import numpy as np
import pytest

from jaxgeo.data import Trajectory
from jaxgeo.geometry import rigid
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.keyframe_graph import carried_covariance, covariance_between, edge_covariance
from jaxgeo.mapping.keyframes import Keyframes
from jaxgeo.mapping.loop_closed import LoopClosed, carried_to_all, close_loops, noise_factor, support
from jaxgeo.solve.closure_graph import ClosureSettings

GNC = ClosureSettings(loss="gnc", loss_width=4.1, start="given")
SIGMA = np.array([0.02] * 3 + [0.003] * 3)


def ring(n: int = 40) -> np.ndarray:
    """Level poses once round a circle of 10 m radius, facing along it, back at the start."""
    angle = np.linspace(0.0, 2.0 * np.pi, n)
    T = rigid.exp(np.column_stack([np.zeros((n, 5)), angle + np.pi / 2]))
    T[:, 0, 3], T[:, 1, 3] = 10.0 * np.cos(angle), 10.0 * np.sin(angle)
    return T


def drifted(truth: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    poses = [truth[0]]
    for step in rigid.inverse(truth[:-1]) @ truth[1:]:
        poses.append(poses[-1] @ step @ rigid.exp(tangent))
    return np.stack(poses)


def closure(
    truth: np.ndarray, first: int, second: int, rng: np.random.Generator, off: np.ndarray | float = 0.0
) -> Closure:
    T = rigid.inverse(truth[first]) @ truth[second] @ rigid.exp(SIGMA * rng.normal(size=6) + off)
    return Closure(first, second, T, np.diag(SIGMA**-2), 0.8, "lidar")


def covariance_of(n: int) -> np.ndarray:
    return edge_covariance(default_noise("lidar"), np.full(n - 1, 1.6), np.full(n - 1, 0.16))


@pytest.fixture(scope="module")
def solved() -> tuple[np.ndarray, np.ndarray, list[Closure], list[bool], LoopClosed]:
    """Odometry that drifts far beyond its noise, neighbours that drift less, true and false closures."""
    rng = np.random.default_rng(5)
    truth = ring()
    odometry = drifted(truth, np.array([0.02, 0.01, 0, 0, 0, 0.012]))
    half = drifted(truth, np.array([0.005, 0, 0, 0, 0, 0.003]))
    stiff = [closure(half, k, k + 1, rng) for k in range(39)]
    true = [closure(truth, i, 39 - j, rng) for i in range(6) for j in range(0, 6, 2)]
    false = [closure(truth, i, j, rng, np.array([3.0, -2.0, 0.5, 0, 0, 0.7])) for i, j in ((5, 20), (9, 31))]
    mixed = [true[0], false[0], *true[1:9], false[1], *true[9:]]
    is_true = [not any(c is other for other in false) for c in mixed]
    return truth, odometry, mixed, is_true, close_loops(odometry, covariance_of(40), mixed, GNC, neighbours=stiff)


def test_false_closures_are_rejected_and_true_ones_kept(solved):
    _, _, _, is_true, found = solved
    assert found.result == "converged"
    assert (found.weight > 0.5).tolist() == is_true
    assert (found.chi2_after[np.array(is_true)] < 22.5).all()


def test_the_ring_is_closed(solved):
    truth, odometry, _, _, found = solved
    gap_before = np.linalg.norm(odometry[-1, :3, 3] - truth[-1, :3, 3])
    gap_after = np.linalg.norm(found.T_map_body[-1, :3, 3] - truth[-1, :3, 3])
    assert gap_before > 1.0
    assert gap_after < 0.2
    assert np.array_equal(found.T_map_body[0], odometry[0]) or np.allclose(found.T_map_body[0], odometry[0], atol=1e-12)


def test_the_drift_s_size_is_learned_from_closures_that_support_one_another(solved):
    _, odometry, mixed, is_true, found = solved
    covariance = covariance_of(40)
    assert found.noise_factor > 2.0
    supported = np.array(support(odometry, covariance, mixed))
    assert not supported[~np.array(is_true)].any()
    assert supported.sum() > 9  # of 18
    assert support(odometry, covariance, mixed[:1]) == [False]  # one closure alone proves nothing
    assert noise_factor(odometry, covariance, []) == 1.0


def test_odometry_as_good_as_assumed_is_not_doubted():
    rng = np.random.default_rng(6)
    truth = ring()
    true = [closure(truth, i, 39 - j, rng) for i, j in ((0, 0), (1, 0), (2, 1), (0, 2), (3, 3))]
    assert noise_factor(truth, covariance_of(40), true) == 1.0


def test_no_closures_change_nothing():
    truth = ring()
    found = close_loops(truth, covariance_of(40), [], GNC)
    assert np.array_equal(found.T_map_body, truth)
    assert found.weight.shape == (0,)


def test_covariance_between_poses_adds_up_as_simulated():
    rng = np.random.default_rng(7)
    truth = ring(12)
    covariance = covariance_of(12) * 4.0
    carried = carried_covariance(truth, covariance)
    draws = []
    steps = rigid.inverse(truth[:-1]) @ truth[1:]
    root = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    for _ in range(600):
        noisy = steps @ rigid.exp(root * rng.normal(size=root.shape))
        T = np.eye(4)
        for step in noisy[2:9]:
            T = T @ step
        draws.append(rigid.log(rigid.inverse(rigid.inverse(truth[2]) @ truth[9]) @ T))
    sampled = np.cov(np.array(draws).T)
    expected = covariance_between(truth, carried, 2, 9)
    ratio = np.linalg.eigvals(np.linalg.solve(expected, sampled)).real
    assert 0.7 < ratio.min() < ratio.max() < 1.4


@pytest.fixture
def path() -> tuple[Trajectory, Keyframes]:
    T = ring(31)
    trajectory = Trajectory(np.arange(31.0), *rigid.parts(T))
    rows = np.array([2, 10, 20, 27])
    return trajectory, Keyframes(trajectory.stamp_s[rows], T[rows], rows)


def test_keyframes_land_where_they_were_solved(path):
    trajectory, keyframes = path
    solved = keyframes.T_map_body @ rigid.exp(0.1 * np.random.default_rng(8).normal(size=(4, 6)))
    moved = carried_to_all(trajectory, keyframes, solved)
    assert np.array_equal(moved.stamp_s, trajectory.stamp_s)
    assert np.allclose(rigid.trajectory_matrices(moved)[keyframes.source], solved, atol=1e-9)


def test_keyframes_moved_alike_move_every_pose_so(path):
    trajectory, keyframes = path
    rigidly = rigid.exp(np.array([3.0, -1.0, 0.5, 0.1, -0.2, 0.7]))
    moved = carried_to_all(trajectory, keyframes, rigidly @ keyframes.T_map_body)
    assert np.allclose(rigid.trajectory_matrices(moved), rigidly @ rigid.trajectory_matrices(trajectory), atol=1e-9)
