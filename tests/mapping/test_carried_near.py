import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_carry import moved

from jaxgeo.data import Trajectory
from jaxgeo.mapping.carried_near import carry_near, reach_of, stations_of
from jaxgeo.mapping.carry import pose_corrections

N = 400
SHIFT_M = np.array([100.0, 200.0, 3.0])


def along_a_line(length_m: float = 60.0) -> Trajectory:
    position_m = np.column_stack([np.linspace(0.0, length_m, N), np.zeros(N), np.zeros(N)])
    return Trajectory(np.arange(N) / 10.0, position_m, np.tile([1.0, 0.0, 0.0, 0.0], (N, 1)))


def there_and_back(apart_m: float = 1.0) -> Trajectory:
    """To x = 30 m and back beside it."""
    line = along_a_line()
    x, y = line.position_m[:, 0], np.where(line.position_m[:, 0] > 30.0, apart_m, 0.0)
    position_m = np.column_stack([np.minimum(x, 60.0 - x), y, np.zeros(N)])
    return Trajectory(line.stamp_s, position_m, line.quat_wxyz)


def bent(trajectory: Trajectory) -> Trajectory:
    """A heading that turns by 0.2 rad from the first pose to the last."""
    yaw = Rotation.from_rotvec(np.linspace(0.0, 0.2, N)[:, None] * [0.0, 0.0, 1.0])
    step_m = yaw[:-1].apply(np.diff(trajectory.position_m, axis=0))
    position_m = np.concatenate([trajectory.position_m[:1], trajectory.position_m[0] + np.cumsum(step_m, axis=0)])
    return Trajectory(trajectory.stamp_s, position_m, yaw.as_quat(scalar_first=True))


def test_a_rigid_motion_moves_the_cloud_rigidly() -> None:
    before, rotation = there_and_back(), Rotation.from_rotvec([0.3, -0.2, 2.0])
    corrections = pose_corrections(before, moved(before, rotation, SHIFT_M))
    points_m = np.random.default_rng(0).uniform(-20, 60, (500, 3))
    found = carry_near(corrections, stations_of(corrections), points_m, 100.0, points_m)
    np.testing.assert_allclose(found.points_m, rotation.apply(points_m) + SHIFT_M, atol=1e-9)
    np.testing.assert_allclose(found.normal, rotation.apply(points_m), atol=1e-9)
    assert found.gap_m.max() < 1e-9


def test_stations_are_even_whatever_time_is_spent_where() -> None:
    line = along_a_line()
    x = np.concatenate([np.zeros(N // 2), np.linspace(0.0, 60.0, N // 2)])  # waits, then walks
    waiting = Trajectory(line.stamp_s, line.position_m * [0.0, 0.0, 0.0] + x[:, None] * [1.0, 0.0, 0.0], line.quat_wxyz)
    stations = stations_of(pose_corrections(waiting, waiting))
    assert np.diff(waiting.position_m[stations.index, 0]).max() < 1.0
    assert np.sum(stations.index < N // 2) == 1


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.2, -0.1]])
def test_no_seams(direction: list[float]) -> None:
    """Along lines across the cloud the longest step shrinks with the steps: at a seam it would stay."""
    before = there_and_back()
    corrections = pose_corrections(before, bent(before))
    stations = stations_of(corrections)

    def longest_step_m(n: int) -> float:
        line_m = np.array([5.0, -3.0, 1.0]) + np.linspace(0.0, 15.0, n)[:, None] * direction
        carried_m = carry_near(corrections, stations, line_m, 10.0).points_m
        return float(np.linalg.norm(np.diff(carried_m, axis=0), axis=1).max())

    assert longest_step_m(3_001) / longest_step_m(30_001) > 8.0


def test_near_the_path_it_follows_the_pose_beside_it() -> None:
    before = along_a_line()
    after = bent(before)
    corrections = pose_corrections(before, after)
    pose = np.arange(40, N - 40)
    yaw = Rotation.from_quat(after.quat_wxyz[pose], scalar_first=True)
    beside_m = np.array([0.0, 2.0, 0.0])
    found = carry_near(corrections, stations_of(corrections), before.position_m[pose] + beside_m, 10.0)
    off_m = np.linalg.norm(found.points_m - yaw.apply(beside_m) - after.position_m[pose], axis=1)
    assert off_m.max() < 0.01
    assert not found.twice.any()


def test_two_passes_are_said_and_their_gap_measured() -> None:
    before = there_and_back()
    raised = Trajectory(
        before.stamp_s,
        before.position_m + np.where(np.arange(N) > N // 2, 0.7, 0.0)[:, None] * [0, 0, 1],
        before.quat_wxyz,
    )
    corrections = pose_corrections(before, raised)
    points_m = np.array([[10.0, 0.5, 0.0], [10.0, 0.6, 0.0], [10.0, -6.0, 0.0]])
    found = carry_near(corrections, stations_of(corrections), points_m, 5.0)
    assert found.twice.tolist() == [True, True, False]
    np.testing.assert_allclose(found.gap_m, [0.7, 0.7, 0.0], atol=1e-6)
    assert found.points_m[0, 2] == pytest.approx(0.35)
    assert 0.35 < found.points_m[1, 2] < 0.7


def test_a_pass_beyond_the_neighbours_is_seen_within_reach() -> None:
    """The nearest stations are all of one pass; the other, 8 m off, may have seen the point all the same."""
    before = there_and_back(8.0)
    corrections = pose_corrections(before, bent(before))
    stations = stations_of(corrections)
    points_m = np.column_stack([np.linspace(1.0, 20.0, 50), np.full(50, 1.0), np.zeros(50)])
    assert carry_near(corrections, stations, points_m, 15.0).twice.all()
    assert not carry_near(corrections, stations, points_m, 5.0).twice.any()
    assert reach_of(corrections, stations, points_m) == pytest.approx(1.0, abs=0.05)


def test_a_trajectory_of_two_poses() -> None:
    before = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
    corrections = pose_corrections(before, moved(before, Rotation.identity(), np.array([1.0, 2.0, 3.0])))
    found = carry_near(corrections, stations_of(corrections), np.zeros((2, 3)), 10.0)
    np.testing.assert_allclose(found.points_m, [[1.0, 2.0, 3.0]] * 2)
