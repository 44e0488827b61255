import copy

import numpy as np
import pytest
from data_root import data_root
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from eval.reference import absolute_error, associate, relative_errors
from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError


def walk(n: int = 300, seed: int = 0) -> Trajectory:
    """A smooth path of about 100 m at 10 Hz."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(np.cumsum(rng.normal(size=(n, 3)) * 0.02, axis=0))
    position = np.cumsum(turn.apply(np.array([0.3, 0.0, 0.0])), axis=0)
    return Trajectory(1.6e9 + 0.1 * np.arange(n), position, turn.as_quat(scalar_first=True))


def drifted(run: Trajectory, seed: int = 1) -> Trajectory:
    """Turned, scaled, shifted, and with a random walk on it."""
    rng = np.random.default_rng(seed)
    n = len(run)
    turn = Rotation.random(rng=rng)
    position = 1.1 * turn.apply(run.position_m) + [5.0, -3.0, 1.0] + np.cumsum(rng.normal(size=(n, 3)) * 0.03, axis=0)
    body = Rotation.from_rotvec(np.cumsum(rng.normal(size=(n, 3)) * 0.003, axis=0))
    quat = (turn * Rotation.from_quat(run.quat_wxyz, scalar_first=True) * body).as_quat(scalar_first=True)
    return Trajectory(run.stamp_s, position, quat)


def moved_body(run: Trajectory, t_m, rotvec_rad) -> Trajectory:
    turn = Rotation.from_quat(run.quat_wxyz, scalar_first=True)
    quat = (turn * Rotation.from_rotvec(rotvec_rad)).as_quat(scalar_first=True)
    return Trajectory(run.stamp_s, run.position_m + turn.apply(t_m), quat)


def as_evo(run: Trajectory) -> PoseTrajectory3D:
    return PoseTrajectory3D(run.position_m.copy(), run.quat_wxyz.copy(), run.stamp_s.copy())


@pytest.mark.parametrize("align", ["none", "se3", "sim3"])
def test_absolute_error_as_evo(align):
    reference, estimate = walk(), drifted(walk())
    theirs, moved = as_evo(reference), copy.deepcopy(as_evo(estimate))
    if align != "none":
        moved.align(theirs, correct_scale=align == "sim3")
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((theirs, moved))
    found = absolute_error(estimate, reference, align=align)
    assert_allclose(found.error_m, ape.error, atol=1e-9)
    assert_allclose(found.ate_rmse_m, ape.get_statistic(metrics.StatisticsType.rmse), rtol=1e-9)
    assert_allclose(found.ate_median_m, ape.get_statistic(metrics.StatisticsType.median), rtol=1e-9)
    assert found.n_poses == 300


@pytest.mark.parametrize("distance_m", [5.0, 30.0])
def test_relative_error_as_evo(distance_m):
    reference, estimate = walk(), drifted(walk())
    (found,) = relative_errors(estimate, reference, [distance_m])
    for relation, ours in (
        (metrics.PoseRelation.translation_part, found.translation_rmse_m),
        (metrics.PoseRelation.rotation_angle_rad, found.rotation_rmse_rad),
    ):
        rpe = metrics.RPE(
            relation, distance_m, metrics.Unit.meters, rel_delta_tol=0.1, all_pairs=True, pairs_from_reference=True
        )
        rpe.process_data((as_evo(reference), as_evo(estimate)))
        assert_allclose(ours, rpe.get_statistic(metrics.StatisticsType.rmse), rtol=1e-9)
        assert found.count == len(rpe.error)


def test_no_pair_that_far_apart():
    (found,) = relative_errors(walk(), walk(), [1e4])
    assert found.count == 0
    assert np.isnan(found.translation_rmse_m)


def test_reference_on_another_body_and_another_clock():
    """Exactly the same motion, seen from elsewhere on the rig, at other stamps: error from interpolation alone."""
    estimate = walk()
    t_m, rotvec_rad = [0.3, -0.2, 1.5], [0.4, -1.0, 2.0]
    found = absolute_error(estimate, moved_body(estimate, t_m, rotvec_rad), t_body_reference_m=t_m, align="none")
    assert found.ate_rmse_m < 1e-12
    # Every third pose of the reference left out: the screw between two poses stays within millimetres of the walk.
    reference = moved_body(estimate, t_m, rotvec_rad)
    keep = np.arange(300) % 3 != 1
    thinned = Trajectory(reference.stamp_s[keep], reference.position_m[keep], reference.quat_wxyz[keep])
    found = absolute_error(estimate, thinned, t_body_reference_m=t_m, align="none")
    assert found.n_poses == 300
    assert 1e-6 < found.ate_rmse_m < 0.05
    (relative,) = relative_errors(
        estimate, reference, [10.0], t_body_reference_m=t_m, rotvec_body_reference_rad=rotvec_rad
    )
    assert relative.translation_rmse_m < 1e-11
    assert relative.rotation_rmse_rad < 1e-11


def test_association():
    reference = np.array([0.0, 1.0, 2.0, 12.0, 13.0])
    stamp = np.array([-0.1, 0.0, 0.5, 2.0, 2.1, 11.9, 12.0, 12.5, 13.0, 13.1])
    assert_array_equal(associate(stamp, reference, 1.0), [0, 1, 1, 1, 0, 0, 1, 1, 1, 0])
    assert associate(stamp, reference, 10.0).sum() == 8


def test_what_the_reference_does_not_cover_is_left_out():
    estimate = walk()
    part = Trajectory(*(column[50:200] for column in (estimate.stamp_s, estimate.position_m, estimate.quat_wxyz)))
    found = absolute_error(estimate, part, align="none")
    assert found.n_poses == 150
    assert_array_equal(found.stamp_s, part.stamp_s)
    assert found.ate_rmse_m < 1e-12


def test_nothing_in_common():
    estimate = walk()
    later = Trajectory(estimate.stamp_s + 1e4, estimate.position_m, estimate.quat_wxyz)
    with pytest.raises(TrajectoryError, match="covers 0 stamps of the trajectory"):
        absolute_error(estimate, later)


def test_vio_of_tagslam_against_its_reference():
    """The data's README gives 0.69 m (SE3) and 0.59 m (Sim3) for it."""
    folder = data_root() / "tagslam" / "test_11"
    columns = [np.loadtxt(folder / name) for name in ("vio_odom.tum", "tagslam_reference_odom.tum")]
    estimate, reference = (Trajectory(c[:, 0], c[:, 1:4], c[:, [7, 4, 5, 6]]) for c in columns)
    rig_odom = Rotation.from_rotvec([-1.50468965e-2, -1.17231429e-3, -3.13883257])
    t_odom_rig = -rig_odom.inv().apply([0.02535438, 0.02040908, -0.02218717])
    for align, expected_m in (("se3", 0.69), ("sim3", 0.59)):
        found = absolute_error(estimate, reference, t_body_reference_m=t_odom_rig, align=align)
        assert found.ate_rmse_m == pytest.approx(expected_m, abs=0.02)
    (relative,) = relative_errors(
        estimate,
        reference,
        [10.0],
        t_body_reference_m=t_odom_rig,
        rotvec_body_reference_rad=rig_odom.inv().as_rotvec(),
    )
    assert relative.rotation_rmse_rad < 0.05
