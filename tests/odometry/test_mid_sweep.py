import numpy as np
import pytest
from box_world import drive

from jaxgeo.geometry.rigid import exp, inverse
from jaxgeo.odometry.mid_sweep import centred, poses_at_stamps

TWIST = np.array([2.0, 0.3, 0.0, 0.1, 0.0, 0.8])


def test_the_middle_of_a_sweep_is_its_new_stamp_and_the_points_times_stay():
    scan = drive(1, TWIST)[0][0]
    middle = centred(scan)
    assert scan.time_s is not None
    assert middle.time_s is not None
    assert middle.stamp_s == pytest.approx(scan.stamp_s - 0.05)
    np.testing.assert_allclose(middle.stamp_s + middle.time_s, scan.stamp_s + scan.time_s, rtol=0, atol=1e-9)
    assert middle.time_s.max() == pytest.approx(-middle.time_s.min())


@pytest.mark.parametrize("offset_s", [-0.05, 0.05, 0.0])
@pytest.mark.parametrize("gap_s", [0.0, 8.0])
def test_poses_at_stamps_are_those_of_the_motion_beside_a_gap_too(offset_s, gap_s):
    # The sensor stands still in the gap; a stamp just before or after it belongs to the motion on its own side
    moving_s = 0.1 * np.arange(8) + 0.05
    stamp_s = moving_s + offset_s + np.where(np.arange(8) >= 4, gap_s, 0.0)
    middle_s = stamp_s - offset_s
    found = poses_at_stamps(middle_s, [exp(t * TWIST) for t in moving_s], stamp_s)
    truth = np.array([exp((t + offset_s) * TWIST) for t in moving_s])
    np.testing.assert_allclose(found, inverse(truth[0]) @ truth, atol=1e-9)
