"""The true noise is what the estimator means by it: its covariance of a pose is that of many simulated ones."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from solve.chain_session import NOISE, Session, anchors_at, graph_of, trajectory_of

from jaxgeo.data import Trajectory
from jaxgeo.graph.components import BIAS_ROT, BIAS_TRANS, BOUNDED, COMPONENTS, LOG_SCALE, N_COMPONENTS, TRANS
from jaxgeo.graph.pose_graph import Globals, PoseGraph, Terms, chain_noise
from jaxgeo.simulate import UAV, UGV, Drift, paper_drift, simulate_session
from jaxgeo.simulate.course import Course, course_along, course_of
from jaxgeo.simulate.drift import drifting_poses
from jaxgeo.simulate.true_noise import error_after_fit_m, true_noise
from jaxgeo.solve.drift import drift_at, own_covariance
from jaxgeo.solve.linearise import edges_at

N, DRAWS = 120, 250
AT = np.array([40, N - 1])
WANDER_M = 25.0
# Small, so that the second order does not show.
KINDS = {
    "white": Drift(sigma_trans_m_per_sqrt_m=(0.001, 0.002, 0.004)),
    "turns": Drift(sigma_rot_rad_per_sqrt_m=(1e-4, 3e-4, 2e-4)),
    "turned": Drift(sigma_turn_rad_per_sqrt_rad=4e-4),
    "heavy": Drift(sigma_trans_m_per_sqrt_m=(0.002, 0.002, 0.002), student_dof=6.0),
    "bias": Drift(bias_trans_m_per_m=(1e-3, 1e-3, 1e-3)),
    "turning": Drift(bias_rot_rad_per_m=(1e-5, 1e-5, 1e-5)),
    "scale": Drift(log_scale=1e-3),
    "wander": Drift(wander_trans_m_per_m=(1e-3, 1e-3, 1e-3), wander_correlation_m=WANDER_M),
    "wandering turn": Drift(wander_rot_rad_per_m=(1e-5, 1e-5, 1e-5), wander_correlation_m=WANDER_M),
    "wandering scale": Drift(wander_log_scale=1e-3, wander_correlation_m=WANDER_M),
}


@pytest.fixture(scope="module")
def course() -> Course:
    """The UAV's walk with poses few and far between."""
    return course_along(course_of(UAV).walk, np.linspace(0.0, UAV.duration_s, N))


@jax.jit
def unit_covariances(graph: PoseGraph, left: jax.Array, at: jax.Array, correlation_m: jax.Array) -> jax.Array:
    zero = jnp.zeros(3)
    glob = Globals(tuple(zero), tuple(zero), jnp.zeros(()))
    edges = edges_at(graph.base, chain_noise(graph.base, glob, graph), glob, jnp.ones(()), graph)
    return own_covariance(left, drift_at(edges, graph, at), correlation_m)


def predicted(course: Course, correlation_m: float) -> np.ndarray:
    """(components, poses): variance of the position under unit noise, all axes together."""
    poses = course.pose[0].inv() * course.pose
    trajectory = trajectory_of(poses)
    made = Session(trajectory, trajectory, anchors_at(poses, np.linspace(0, N - 1, 7).astype(int)), NOISE)
    graph = graph_of(made, Terms(log_scale=True))
    where = np.stack([np.asarray(axis)[AT] for axis in graph.base.t], axis=1)
    # A world-frame increment (u, w) moves a position p by u + w x p.
    left = np.zeros((len(AT), 3, 6))
    left[:, :, :3] = np.eye(3)
    for i, (x, y, z) in enumerate(where):
        left[i, :, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    unit = unit_covariances(graph, left, AT, jnp.asarray(correlation_m))
    return np.trace(np.asarray(unit), axis1=-2, axis2=-1)


def drawn(drift: Drift, random: np.random.Generator) -> Drift:
    """What is constant, drawn: its value stands for the standard deviation."""
    t, r = random.standard_normal((2, 3))
    return dataclasses.replace(
        drift,
        bias_trans_m_per_m=tuple(t * drift.bias_trans_m_per_m),
        bias_rot_rad_per_m=tuple(r * drift.bias_rot_rad_per_m),
        log_scale=drift.log_scale * random.standard_normal(),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_simulated_poses_scatter_as_the_true_noise_says(kind, course):
    random = np.random.default_rng(0)
    poses = course.pose[0].inv() * course.pose
    truth = trajectory_of(poses)
    square, variance = np.zeros(len(AT)), np.zeros(N_COMPONENTS)
    for seed in range(DRAWS):
        drift = drawn(KINDS[kind], random)
        made = trajectory_of(drifting_poses(course, drift, np.random.SeedSequence(seed)))
        noise = true_noise(made, truth, drift)
        square += np.sum((made.position_m[AT] - truth.position_m[AT]) ** 2, axis=1) / DRAWS
        variance += np.asarray(noise.sigma[0]) ** 2 / DRAWS
    unit = predicted(course, float(noise.correlation_m))
    # 250 draws know a variance to a tenth where one direction has all of it, better where three share it.
    np.testing.assert_allclose(square, variance @ unit, rtol=0.3)


def test_sigmas_are_per_metre_of_the_odometrys_own_way():
    """Noise makes it longer: the same variance on more metres, the same way to forget in more of them."""
    drift = Drift(
        sigma_trans_m_per_sqrt_m=(0.14, 0.14, 0.14),
        wander_trans_m_per_m=(0.01, 0.01, 0.01),
        wander_correlation_m=30.0,
        bias_trans_m_per_m=(0.0, 0.03, 0.0),
        log_scale=-0.2,
    )
    session = simulate_session(0, drift={"icp": drift})
    way_m = [
        np.linalg.norm(np.diff(t.position_m, axis=0), axis=1).sum()
        for t in (session.trajectories["icp"], session.truth)
    ]
    longer = way_m[0] / way_m[1]
    assert longer > 1.2
    noise = session.true_noise("icp")
    sigma = np.asarray(noise.sigma[0])
    np.testing.assert_allclose(sigma[TRANS] ** 2 * way_m[0], 0.14**2 * way_m[1])
    np.testing.assert_allclose(sigma[BIAS_TRANS] * way_m[0], 0.03 / np.sqrt(3) * way_m[1])
    np.testing.assert_allclose(noise.correlation_m, 30.0 * longer)
    np.testing.assert_allclose(sigma[LOG_SCALE], 0.2)
    assert (sigma[BIAS_ROT], sigma[BOUNDED]) == (0.0, 0.0)
    np.testing.assert_array_equal(noise.weight, [1.0])


def test_a_loop_closed_trajectory_has_a_bounded_error_and_no_bias():
    session = simulate_session(1, UGV, drift=paper_drift(UGV))
    sigma = np.asarray(session.true_noise("dense").sigma[0])
    error_m = error_after_fit_m(session.trajectories["dense"], session.truth)
    np.testing.assert_allclose(sigma[BOUNDED], np.sqrt(np.mean(error_m**2)))
    assert 1.0 < sigma[BOUNDED] < 20.0
    free = {name for name, value in zip(COMPONENTS, sigma, strict=True) if value > 0}
    assert free == {*COMPONENTS[:7], "bounded_m"}
    assert 5.0 < session.true_noise("dense").correlation_m < 100.0


def test_the_best_fit_leaves_what_no_rigid_motion_can_take_away():
    random = np.random.default_rng(3)
    position_m = random.standard_normal((50, 3)) * [20.0, 10.0, 1.0]
    truth = Trajectory(np.arange(50.0), position_m, np.tile([1.0, 0.0, 0.0, 0.0], (50, 1)))
    motion = RigidTransform.from_components([5.0, -3.0, 2.0], Rotation.from_rotvec([0.3, -2.0, 0.5]))
    moved = dataclasses.replace(truth, position_m=motion.apply(position_m))
    np.testing.assert_allclose(error_after_fit_m(moved, truth), 0.0, atol=1e-12)
    noisy = dataclasses.replace(moved, position_m=moved.position_m + 0.1 * random.standard_normal((50, 3)))
    best = np.sum(error_after_fit_m(noisy, truth) ** 2)
    for _ in range(20):
        nudge = RigidTransform.from_exp_coords(0.01 * random.standard_normal(6))
        worse = (nudge * motion.inv()).apply(noisy.position_m) - position_m
        assert best < np.sum(worse**2)
