import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_carry import moved, wandering

from jaxgeo.data import Trajectory
from jaxgeo.errors import CloudError
from jaxgeo.mapping.carried_extent import Extent, check_one_frame, check_same_motion, mean_correction
from jaxgeo.mapping.carry import pose_corrections

TURN, SHIFT_M = Rotation.from_rotvec([0.2, -0.1, 2.5]), np.array([300.0, 400.0, 5.0])


def test_of_a_rigid_motion_the_mean_is_that_motion() -> None:
    before = wandering(0)
    mean = mean_correction(pose_corrections(before, moved(before, TURN, SHIFT_M)))
    points_m = np.random.default_rng(0).normal(0, 20, (50, 3))
    np.testing.assert_allclose(mean.apply(points_m), TURN.apply(points_m) + SHIFT_M, atol=1e-9)


def test_the_extent_does_not_depend_on_the_pieces() -> None:
    random = np.random.default_rng(0)
    carried_m, rigid_m = random.normal(size=(2, 100, 3))
    whole, pieces = Extent(), Extent()
    whole.add(carried_m, rigid_m)
    for rows in np.split(np.arange(100), [0, 13, 64]):
        pieces.add(carried_m[rows], rigid_m[rows])
    away_m = np.linalg.norm(carried_m - rigid_m, axis=1)
    for extent in (whole, pieces):
        assert extent.n == 100
        assert extent.rms_m == pytest.approx(np.sqrt(np.mean(away_m**2)))
        assert extent.largest_m == pytest.approx(away_m.max())


def test_a_corrected_trajectory_has_the_same_motions() -> None:
    before = wandering(1)
    drift_m = np.cumsum(0.05 * np.random.default_rng(0).normal(size=(len(before), 3)), axis=0)
    after = moved(Trajectory(before.stamp_s, before.position_m + drift_m, before.quat_wxyz), TURN, SHIFT_M)
    check_same_motion(pose_corrections(before, after))
    still = Trajectory(before.stamp_s, np.zeros((len(before), 3)), before.quat_wxyz)
    check_same_motion(pose_corrections(still, still))


def test_other_body_axes_another_scale_and_another_recording_have_not() -> None:
    before = wandering(1)
    axes = Rotation.from_rotvec([0.0, 0.0, np.pi / 2])
    body = (Rotation.from_quat(before.quat_wxyz, scalar_first=True) * axes).as_quat(scalar_first=True)
    with pytest.raises(CloudError, match=r"the motions .* differ by 127%.*Have the bodies the same axes"):
        check_same_motion(pose_corrections(before, Trajectory(before.stamp_s, before.position_m, body)))
    larger = Trajectory(before.stamp_s, 3.0 * before.position_m, before.quat_wxyz)
    with pytest.raises(CloudError, match=r"differ by 200%.*3 times as long.*--scale"):
        check_same_motion(pose_corrections(before, larger))
    check_same_motion(pose_corrections(before, larger, scale=3.0))


def test_a_cloud_in_another_frame_is_refused() -> None:
    corrections = pose_corrections(wandering(1), wandering(1))
    check_one_frame(corrections, np.zeros((0, 3)))
    check_one_frame(corrections, np.full((3, 3), 1_000.0))
    with pytest.raises(CloudError, match=r"the cloud lies 110393 m from the trajectory.*both in one frame"):
        check_one_frame(corrections, np.tile([79_300.0, 76_800.0, 300.0], (3, 1)))
