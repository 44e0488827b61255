"""Every kind of drift has the size asked for, and draws from a stream of its own."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.errors import InputError
from jaxgeo.simulate import UAV, Drift, LoopClosure, paper_drift, simulate_session
from jaxgeo.simulate.course import Course, course_along, course_of
from jaxgeo.simulate.drift import drifting_poses, drifting_steps
from jaxgeo.simulate.prefix import chain, gauss_markov, prefix_products

SEED = np.random.SeedSequence(1)
N, TURN_RAD = 20_000, 0.3
WHITE = Drift(
    sigma_trans_m_per_sqrt_m=(0.01, 0.02, 0.03),
    sigma_rot_rad_per_sqrt_m=(0.002, 0.003, 0.004),
    sigma_turn_rad_per_sqrt_rad=0.001,
    bias_trans_m_per_m=(0.01, 0.0, -0.02),
    bias_rot_rad_per_m=(0.0, 0.005, 0.0),
)


@pytest.fixture(scope="module")
def long_course() -> Course:
    """Steps of 0.05 to 0.5 m, each with the same turn."""
    length_m = np.random.default_rng(0).uniform(0.05, 0.5, N)
    step = RigidTransform.from_components(
        length_m[:, None] * [1.0, 0.0, 0.0], Rotation.from_rotvec(np.tile([0.0, 0.0, TURN_RAD], (N, 1)))
    )
    short = course_of(UAV)
    return dataclasses.replace(
        short, pose=chain(step), step=step, length_m=length_m, turn_rad=step.rotation.magnitude()
    )


@pytest.fixture(scope="module")
def course() -> Course:
    return course_of(UAV)


def missed(course: Course, drift: Drift, seed: np.random.SeedSequence = SEED) -> np.ndarray:
    """Log(O^-1 T_k^-1 T_{k+1}), (n, 6) translation and rotation: noise and bias of each step."""
    coordinates = (drifting_steps(course, drift, seed).inv() * course.step).as_exp_coords()
    return np.hstack([coordinates[:, 3:], coordinates[:, :3]])


def without_bias(noise: np.ndarray, course: Course, drift: Drift) -> np.ndarray:
    return noise - course.length_m[:, None] * [*drift.bias_trans_m_per_m, *drift.bias_rot_rad_per_m]


def assert_white(noise: np.ndarray, course: Course, drift: Drift, rtol: float) -> None:
    # Means of n draws, in standard deviations: the bias was all there was.
    assert np.all(np.abs(noise.mean(axis=0)) < 4 * noise.std(axis=0) / np.sqrt(N))
    by_turn = drift.sigma_turn_rad_per_sqrt_rad**2 * TURN_RAD * np.array([0, 0, 0, 1, 1, 1])
    white = (np.mean(noise**2, axis=0) - by_turn) / course.length_m.mean()
    expected = np.square([*drift.sigma_trans_m_per_sqrt_m, *drift.sigma_rot_rad_per_sqrt_m])
    np.testing.assert_allclose(white, expected, rtol=rtol)


def test_white_noise_and_bias_have_the_size_asked_for(long_course):
    assert_white(without_bias(missed(long_course, WHITE), long_course, WHITE), long_course, WHITE, 0.05)


def test_heavy_tails_keep_the_variance_and_are_heavy(long_course):
    heavy = dataclasses.replace(WHITE, student_dof=5.0)
    noise = without_bias(missed(long_course, heavy), long_course, heavy)
    assert_white(noise, long_course, heavy, 0.1)
    scaled = noise[:, :3] / np.sqrt(long_course.length_m)[:, None] / WHITE.sigma_trans_m_per_sqrt_m
    # Kurtosis of Student's t: 3 + 6 / (dof - 4) = 9; its fourth moment converges slowly.
    assert np.mean(scaled**4) > 5.0
    # All axes of a step together, and only their size: the directions are those of the normal draws.
    normal = without_bias(missed(long_course, WHITE), long_course, WHITE)
    ratio = noise / normal
    np.testing.assert_allclose(ratio, ratio[:, :1] * np.ones(6), rtol=1e-5)


def test_gauss_markov_is_its_recursion_and_has_its_covariance():
    random = np.random.default_rng(2)
    length_m = random.uniform(0.1, 3.0, 40)
    unit = random.standard_normal((40, 20_000))
    made = gauss_markov(length_m, 5.0, unit)
    expected = np.empty_like(unit)
    expected[0] = unit[0]
    for k in range(1, 40):
        rho = np.exp(-length_m[k] / 5.0)
        expected[k] = rho * expected[k - 1] + np.sqrt(1 - rho**2) * unit[k]
    np.testing.assert_allclose(made, expected, rtol=0, atol=1e-12)
    along_m = np.cumsum(length_m)
    covariance = made @ made.T / unit.shape[1]
    np.testing.assert_allclose(covariance, np.exp(-np.abs(along_m[:, None] - along_m) / 5.0), atol=0.04)


def test_gauss_markov_of_points_at_one_place_is_constant():
    np.testing.assert_array_equal(gauss_markov(np.zeros(5), 5.0, np.arange(5.0)[:, None] + 1.0), np.ones((5, 1)))


def test_wander_is_a_bias_and_a_scale_that_change_slowly(course):
    drift = Drift(
        wander_trans_m_per_m=(0.01, 0.02, 0.03),
        wander_rot_rad_per_m=(0.001, 0.002, 0.003),
        wander_correlation_m=20.0,
    )
    per_m = missed(course, drift) / course.length_m[:, None]
    along_m = course.distance_m[:-1]
    # Over a metre it keeps nearly all, over the whole walk it swings by its own size.
    near = np.searchsorted(along_m, along_m[along_m < along_m[-1] - 1.0] + 1.0)
    sigma = np.array([*drift.wander_trans_m_per_m, *drift.wander_rot_rad_per_m])
    change = per_m[near] - per_m[: len(near)]
    assert np.all(np.sqrt(np.mean(change**2, axis=0)) < 0.5 * sigma)
    assert np.all(np.ptp(per_m, axis=0) > 1.0 * sigma)
    assert np.all(np.abs(per_m) < 5.0 * sigma)
    scale = Drift(wander_log_scale=0.02, wander_correlation_m=20.0)
    ratio = np.linalg.norm(drifting_steps(course, scale, SEED).translation, axis=1) / course.length_m
    assert 0.005 < np.std(np.log(ratio)) < 0.04
    # 0.02 sqrt(2 d / 20 m) between steps of d metres.
    assert np.std(np.diff(np.log(ratio))) < 0.005


def test_each_source_draws_from_a_stream_of_its_own(course):
    """Turning one source on leaves the other's numbers as they were."""
    white = Drift(sigma_trans_m_per_sqrt_m=(1e-3,) * 3, sigma_rot_rad_per_sqrt_m=(1e-4,) * 3)
    wander = Drift(wander_trans_m_per_m=(1e-3,) * 3, wander_correlation_m=20.0)
    both = dataclasses.replace(white, wander_trans_m_per_m=(1e-3,) * 3, wander_correlation_m=20.0)
    np.testing.assert_allclose(missed(course, both), missed(course, white) + missed(course, wander), atol=2e-7)
    heavy = dataclasses.replace(wander, student_dof=3.0)
    np.testing.assert_array_equal(missed(course, heavy), missed(course, wander))


def test_chain_is_the_product_of_its_steps(course):
    steps = drifting_steps(course, WHITE, SEED)
    expected = np.eye(4)
    made = chain(steps).as_matrix()
    np.testing.assert_array_equal(made[0], np.eye(4))
    for k, step in enumerate(steps.as_matrix()):
        expected = expected @ step
        np.testing.assert_allclose(made[k + 1], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 8, 9])
def test_prefix_products_keep_the_order(n):
    """Composing words: the product of rows 0 .. k is their letters in order."""
    words = np.array([[letter] for letter in "abcdefghi"[:n]], dtype=object)
    made = prefix_products(lambda earlier, later: earlier + later, words)
    assert made[:, 0].tolist() == ["abcdefghi"[: k + 1] for k in range(n)]


def test_a_loop_closure_is_kept_and_nothing_jumps(course):
    drift = dataclasses.replace(WHITE, bias_rot_rad_per_m=(0.0, 0.0, 0.004))
    raw = drifting_poses(course, drift, SEED)
    closed = drifting_poses(course, dataclasses.replace(drift, closures=(LoopClosure(2, 5),)), SEED)
    a, b = course.visit_pose[[1, 4]].tolist()
    seen, true = closed[a].inv() * closed[b], course.pose[a].inv() * course.pose[b]
    np.testing.assert_allclose(seen.as_matrix(), true.as_matrix(), atol=1e-9)
    assert np.linalg.norm((raw[a].inv() * raw[b]).translation - true.translation) > 1.0
    # Before it nothing, after it (and in both visits) nothing but a rigid motion.
    leave, arrive = np.searchsorted(course.distance_m, [course.leave_m[1], course.arrive_m[4]]).tolist()
    np.testing.assert_allclose(closed[:leave].as_matrix(), raw[:leave].as_matrix(), atol=1e-13)
    moved = (closed[arrive:] * raw[arrive:].inv()).as_matrix()
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0], moved.shape), atol=1e-9)
    step = [np.linalg.norm(np.diff(p.translation, axis=0), axis=1) for p in (raw, closed)]
    assert np.abs(step[1] - step[0]).max() < 0.3 * step[0].max()


def test_a_loop_closure_errs_by_its_sigma(course):
    closure = LoopClosure(1, 7, 0.05, 0.01)
    a, b = course.visit_pose[[0, 6]].tolist()
    true = course.pose[a].inv() * course.pose[b]
    errors = [
        (true.inv() * poses[a].inv() * poses[b]).as_exp_coords()
        for seed in range(200)
        for poses in [drifting_poses(course, Drift(closures=(closure,)), np.random.SeedSequence(seed))]
    ]
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(rms, [0.01] * 3 + [0.05] * 3, rtol=0.2)


def test_a_map_built_on_an_odometry_has_its_draws():
    icp = Drift(sigma_trans_m_per_sqrt_m=(0.02,) * 3, sigma_rot_rad_per_sqrt_m=(0.002,) * 3)
    own, shared = dataclasses.replace(icp), dataclasses.replace(icp, draws_of="icp")
    made = simulate_session(0, drift={"icp": icp, "own": own, "map": shared}).trajectories
    np.testing.assert_array_equal(made["map"].position_m, made["icp"].position_m)
    assert np.abs(made["own"].position_m - made["icp"].position_m).max() > 0.05
    # Its closures are its own affair, drawn after everything else.
    dense = paper_drift(UAV)["dense"]
    bent = simulate_session(0, drift={"icp": icp, "map": dense}).trajectories
    np.testing.assert_array_equal(bent["icp"].position_m, made["icp"].position_m)


def test_draws_of_a_trajectory_that_is_not_there_are_refused():
    with pytest.raises(InputError, match="draws_of names 'icp'; the session has map"):
        simulate_session(0, drift={"map": Drift(draws_of="icp")})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"student_dof": 2.0}, "needs more than 2 degrees of freedom"),
        ({"wander_log_scale": 0.1}, "wander_correlation_m: 0"),
        ({"closures": (LoopClosure(7, 1),)}, "visits 7 and 1: expected the earlier first"),
        ({"closures": (LoopClosure(0, 1),)}, "visits 0 and 1"),
    ],
)
def test_a_drift_that_cannot_be_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Drift(**given)


def test_a_closure_of_a_visit_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="closure with visit 8: there are 7 visits"):
        simulate_session(0, drift={"map": Drift(closures=(LoopClosure(1, 8),))})


def test_a_course_has_the_poses_asked_for(course):
    stamp_s = np.linspace(0.0, UAV.duration_s, 50)
    coarse = course_along(course.walk, stamp_s)
    np.testing.assert_allclose(coarse.pose[0].as_matrix(), course.pose[0].as_matrix())
    assert len(coarse.step) == 49
    with pytest.raises(ValueError, match="read-only"):
        coarse.distance_m[0] = 1.0
