import numpy as np
import pytest
from box_world import HALL, scan_at
from hypothesis import given
from hypothesis import strategies as st

from jaxgeo.geometry.rigid import apply, exp
from jaxgeo.odometry.deskew import deskewed

TURNING = np.array([3.0, 0.2, 0.0, 0.1, -0.2, 2.0])


@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array), st.sampled_from([0.0, 1e-12, 1e-4, 1.0]))
def test_each_point_is_moved_by_its_own_pose(twist, turns):
    twist = twist * np.repeat([1.0, turns], 3)
    rng = np.random.default_rng(0)
    points_m, time_s = rng.normal(size=(20, 3)) * 10.0, rng.uniform(-0.2, 0.1, 20)
    expected = [apply(exp(t * twist), p[None])[0] for p, t in zip(points_m, time_s, strict=True)]
    np.testing.assert_allclose(deskewed(points_m, time_s, twist), expected, atol=1e-9)


@pytest.mark.parametrize("straight", [True, False])
def test_a_turning_sweep_is_straightened(straight):
    scan = scan_at(np.eye(4), TURNING, 0.0, noise_m=0.0, boxes=[])
    assert scan.time_s is not None
    points_m = deskewed(scan.points_m, scan.time_s, TURNING) if straight else scan.points_m
    from_wall_m = np.min([np.abs(points_m - side) for side in HALL], axis=0).min(axis=1)
    assert (from_wall_m.max() < 1e-9) == straight
    assert straight or from_wall_m.max() > 0.5
