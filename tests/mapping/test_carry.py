import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import CloudError
from jaxgeo.geometry.se3 import se3_apply, se3_compose, se3_exp, se3_from, se3_inverse, se3_log
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.mapping.carry import carry, places_by_index, places_by_stamp, pose_corrections, turn

EPOCH_S = 1.7e9


def wandering(seed: int, n: int = 12, bend_rad: float = 0.3) -> Trajectory:
    random = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(np.cumsum(bend_rad * random.normal(size=(n, 3)), axis=0))
    stamp_s = EPOCH_S + np.cumsum(random.uniform(0.05, 0.5, n))
    return Trajectory(stamp_s, np.cumsum(random.normal(size=(n, 3)), axis=0), rotation.as_quat(scalar_first=True))


def rotations(trajectory: Trajectory) -> Rotation:
    return Rotation.from_quat(trajectory.quat_wxyz, scalar_first=True)


def moved(trajectory: Trajectory, rotation: Rotation, shift_m: np.ndarray) -> Trajectory:
    quat = (rotation * rotations(trajectory)).as_quat(scalar_first=True)
    return Trajectory(trajectory.stamp_s, rotation.apply(trajectory.position_m) + shift_m, quat)


seeds = st.integers(0, 10**6)
points = hnp.arrays(float, (7, 3), elements=st.floats(-50, 50))
stamps = hnp.arrays(float, 7, elements=st.floats(0, 1))


def stamps_on(trajectory: Trajectory, share: np.ndarray) -> np.ndarray:
    return trajectory.stamp_s[0] + share * (trajectory.stamp_s[-1] - trajectory.stamp_s[0])


@given(seeds, points, stamps)
def test_the_same_trajectory_leaves_the_cloud(seed: int, points_m: np.ndarray, share: np.ndarray) -> None:
    before = wandering(seed)
    corrections = pose_corrections(before, before)
    place, inside = places_by_stamp(corrections, stamps_on(before, share))
    assert inside.all()
    np.testing.assert_allclose(carry(corrections, points_m, place), points_m, atol=1e-12)


@given(seeds, points, stamps, hnp.arrays(float, 3, elements=st.floats(-3, 3)))
def test_a_rigid_motion_moves_the_cloud_rigidly(seed, points_m, share, turn_rad) -> None:
    before, rotation, shift_m = wandering(seed), Rotation.from_rotvec(turn_rad), np.array([4e5, 5.4e6, 300.0])
    corrections = pose_corrections(before, moved(before, rotation, shift_m))
    place, _ = places_by_stamp(corrections, stamps_on(before, share))
    # A step of float64 at UTM northings is 1e-9
    np.testing.assert_allclose(carry(corrections, points_m, place), rotation.apply(points_m) + shift_m, atol=2e-8)
    np.testing.assert_allclose(turn(corrections, points_m, place), rotation.apply(points_m), atol=1e-10)


@given(seeds, points)
def test_what_a_pose_saw_stays_with_it(seed: int, body_m: np.ndarray) -> None:
    before, after = wandering(seed), wandering(seed + 1)
    after = Trajectory(before.stamp_s, after.position_m, after.quat_wxyz)
    index = np.random.default_rng(seed).integers(0, len(before), len(body_m))
    seen_m = rotations(before)[index].apply(body_m) + before.position_m[index]
    expected_m = rotations(after)[index].apply(body_m) + after.position_m[index]
    corrections = pose_corrections(before, after)
    for place, inside in (
        places_by_index(corrections, index),
        places_by_stamp(corrections, before.stamp_s[index]),
    ):
        assert inside.all()
        np.testing.assert_allclose(carry(corrections, seen_m, place), expected_m, atol=1e-10)


@given(seeds, points, stamps)
def test_between_poses_the_correction_follows_its_screw(seed: int, points_m: np.ndarray, share: np.ndarray) -> None:
    before, after = wandering(seed), wandering(seed + 1, bend_rad=0.1)
    after = Trajectory(before.stamp_s, after.position_m, after.quat_wxyz)
    corrections = pose_corrections(before, after)
    place, _ = places_by_stamp(corrections, stamps_on(before, share))

    def correction(i: np.ndarray):
        return se3_compose(
            se3_from(after.position_m[i], after.quat_wxyz[i]),
            se3_inverse(se3_from(before.position_m[i], before.quat_wxyz[i])),
        )

    first, second = correction(place.index), correction(place.index + 1)
    screw = se3_log(se3_compose(se3_inverse(first), second))
    expected = se3_apply(se3_compose(first, se3_exp(place.fraction[:, None] * screw)), points_m)
    np.testing.assert_allclose(carry(corrections, points_m, place), expected, atol=1e-9)


@given(seeds, points, st.floats(0.2, 5.0))
def test_a_scale_stretches_about_the_pose(seed: int, body: np.ndarray, scale: float) -> None:
    before, after = wandering(seed), wandering(seed + 1)
    after = Trajectory(before.stamp_s, after.position_m, after.quat_wxyz)
    index = np.arange(len(body))
    seen = rotations(before)[index].apply(body) + before.position_m[index]
    corrections = pose_corrections(before, after, scale)
    expected_m = rotations(after)[index].apply(scale * body) + after.position_m[index]
    np.testing.assert_allclose(carry(corrections, seen, places_by_index(corrections, index)[0]), expected_m, atol=1e-9)


def test_the_ends_are_held_for_a_little_and_no_longer() -> None:
    before, after = wandering(1), wandering(2)
    after = Trajectory(before.stamp_s, after.position_m, after.quat_wxyz)
    corrections = pose_corrections(before, after)
    first_s, last_s = before.stamp_s[[0, -1]]
    query_s = np.array([first_s - 0.31, first_s - 0.29, first_s, last_s + 0.29, last_s + 0.31, np.nan])
    place, inside = places_by_stamp(corrections, query_s, hold_s=0.3)
    assert inside.tolist() == [False, True, True, True, False, False]
    carried_m = carry(corrections, np.ones((6, 3)), place)
    np.testing.assert_array_equal(carried_m[1], carried_m[2])
    at_last = carry(corrections, np.ones((1, 3)), places_by_index(corrections, np.array([len(before) - 1]))[0])
    np.testing.assert_array_equal(carried_m[3], at_last[0])


def test_indices_count_the_poses_before() -> None:
    corrections = pose_corrections(wandering(1), wandering(1))
    _, known = places_by_index(corrections, np.array([-1, 0, 11, 12], np.int16))
    assert known.tolist() == [False, True, True, False]


def test_poses_that_lost_their_partner_are_interpolated() -> None:
    before = wandering(3)
    kept = np.array([0, 1, 5, 6, 11])
    rotation, shift_m = Rotation.from_rotvec([0.1, 0.2, 3.0]), np.array([9.0, 8.0, 7.0])
    after = moved(before, rotation, shift_m)
    after = Trajectory(after.stamp_s[kept] + 1e-7, after.position_m[kept], after.quat_wxyz[kept])
    with pytest.warns(InputWarning, match="7 of 12 poses before have no partner"):
        corrections = pose_corrections(before, after)
    place, known = places_by_index(corrections, np.arange(12))
    assert known.all()
    np.testing.assert_allclose(
        carry(corrections, before.position_m, place), rotation.apply(before.position_m) + shift_m, atol=1e-9
    )


@pytest.mark.filterwarnings("ignore::jaxgeo.io.input_warning.InputWarning")
def test_a_pose_before_the_first_that_has_a_partner_saw_nothing() -> None:
    before = wandering(3)
    after = Trajectory(before.stamp_s[8:], before.position_m[8:], before.quat_wxyz[8:])
    _, known = places_by_index(pose_corrections(before, after), np.array([0, 8, 11]))
    assert known.tolist() == [False, True, True]


def test_another_trajectory_is_refused() -> None:
    before = wandering(4)
    later = Trajectory(before.stamp_s + 100.0, before.position_m, before.quat_wxyz)
    with pytest.raises(CloudError, match=r"0 of 12 poses before have the stamp of one of the 12 poses after"):
        pose_corrections(before, later)
    with pytest.raises(CloudError, match=r"scale -1\.0"):
        pose_corrections(before, before, -1.0)


def test_many_points_go_in_blocks() -> None:
    before, after = wandering(5), wandering(6)
    after = Trajectory(before.stamp_s, after.position_m, after.quat_wxyz)
    corrections = pose_corrections(before, after)
    points_m = np.random.default_rng(0).normal(size=(300_000, 3))
    place, _ = places_by_stamp(corrections, stamps_on(before, np.linspace(0.0, 1.0, 300_000)))
    some = [0, 131_071, 131_072, 262_143, 262_144, 299_999]
    part = type(place)(place.index[some], place.fraction[some])
    np.testing.assert_allclose(
        carry(corrections, points_m, place)[some], carry(corrections, points_m[some], part), atol=1e-12
    )
