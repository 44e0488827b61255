import numpy as np

from jaxgeo.geometry.rigid import exp
from jaxgeo.odometry.motion import EXTRAPOLATE_S, FLOOR, UNKNOWN, Motion

TWIST = np.array([2.0, 0.0, 0.1, 0.0, 0.1, 0.5])
ACCELERATION = (3.0, 2.0)


def test_a_constant_velocity_is_foretold_whatever_the_intervals():
    motion = Motion(0.0, np.eye(4))
    for stamp_s in (0.1, 0.5, 0.6, 1.3):
        T = exp(stamp_s * TWIST)
        if motion.twist is not None:
            np.testing.assert_allclose(motion.T_map_lidar @ motion.step(stamp_s), T, atol=1e-12)
        assert max(motion.deviation(stamp_s, T)) < 1e-12
        motion = motion.after(stamp_s, T)
    np.testing.assert_allclose(motion.sigma(1.4, ACCELERATION)[[0, 5]], FLOOR + np.array(ACCELERATION) * 0.01)


def test_nothing_is_known_of_a_first_step_and_little_after_a_surprise():
    first = Motion(0.0, np.eye(4))
    np.testing.assert_array_equal(first.sigma(0.1, ACCELERATION), np.repeat(UNKNOWN, 3))
    second = first.after(0.1, exp(0.1 * TWIST))
    off = exp(0.2 * TWIST) @ exp(np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(second.deviation(0.2, off), (3.0, 0.0), atol=1e-7)
    assert second.after(0.2, off).sigma(0.3, ACCELERATION)[0] > 0.5 > second.sigma(0.2, ACCELERATION)[0]


def test_a_gap_is_not_crossed_at_full_speed():
    motion = Motion(0.0, np.eye(4), TWIST)
    np.testing.assert_allclose(motion.step(60.0), exp(EXTRAPOLATE_S * TWIST))
    assert motion.sigma(60.0, ACCELERATION)[0] > 1000.0
