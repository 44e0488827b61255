"""Fused clouds: what a dictionary of voxels gives, whatever the order of the points and the size of the batches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rgbd_room import body_pose, looking, off_walls_m, photograph, pinhole, walls

from jaxgeo.errors import CloudError
from jaxgeo.geometry import rigid
from jaxgeo.mapping import voxel_table
from jaxgeo.mapping.fusion import FusionSettings, PosedCloud, cloud_of_frame, fuse_points, model_distance


def clouds_of(seed: int, n_clouds: int = 7, n: int = 60) -> list[PosedCloud]:
    random = np.random.default_rng(seed)
    stamps = np.cumsum(random.choice([0.0, 1.0, 30.0], n_clouds))
    return [
        PosedCloud(
            float(stamp),
            10 + row,
            rigid.exp(random.normal(size=6) * 0.1),
            random.uniform(-0.5, 0.5, (n, 3)),
            random.integers(0, 256, (n, 3), dtype=np.uint8),
            random.uniform(0.0, 100.0, n),
        )
        for row, stamp in enumerate(stamps)
    ]


def by_dictionary(clouds, settings):
    """The same by loops: passes of each voxel, each with its points."""
    voxels: dict[tuple[int, ...], list[list[tuple]]] = {}
    for cloud in clouds:
        for row, point in enumerate(rigid.apply(cloud.T_map_body, cloud.points_m)):
            passes = voxels.setdefault(tuple(np.floor(point / settings.voxel_m).astype(int).tolist()), [])
            if not passes or cloud.stamp_s - passes[-1][-1][0] > settings.pass_gap_s:
                passes.append([])
            range_m = np.linalg.norm(cloud.points_m[row])
            passes[-1].append(
                (cloud.stamp_s, cloud.pose_index, point, cloud.colour[row], cloud.intensity[row], range_m)
            )
    rows = []
    for passes in voxels.values():
        if sum(len({one[1] for one in seen}) for seen in passes) < settings.min_hits:
            continue
        for seen in passes:
            nearest = min(seen, key=lambda one: one[5])
            mean = [np.mean([one[part] for one in seen], axis=0) for part in (2, 3, 4)]
            rows.append((*mean[0], *np.round(mean[1]), mean[2], *nearest[:2], len({one[1] for one in seen}), len(seen)))
    return np.array(sorted(rows))


def as_rows(cloud):
    parts = (cloud.points_m, cloud.colour, cloud.intensity, cloud.stamp_s, cloud.pose_index, cloud.hits, cloud.count)
    return np.array(sorted(np.column_stack(parts).tolist()))


@given(seed=st.integers(0, 1000), min_hits=st.integers(1, 4), batch=st.sampled_from([1, 50, 10_000]))
def test_fusion_is_that_of_a_dictionary_in_batches_of_any_size(seed, min_hits, batch):
    settings = FusionSettings(voxel_m=0.25, pass_gap_s=10.0, min_hits=min_hits)
    clouds = clouds_of(seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(voxel_table, "_MANY_ROWS", batch)
        fused = fuse_points(iter(clouds), settings)
    expected = by_dictionary(clouds, settings)
    assert len(fused) == len(expected)
    np.testing.assert_allclose(as_rows(fused), expected, atol=1e-9)


def test_passes_stay_apart_or_are_merged():
    def seen(stamp_s, row):
        return PosedCloud(stamp_s, row, np.eye(4), np.array([[0.01 * (row + 1), 0.02, 0.03]]))

    clouds = [seen(stamp, row) for row, stamp in enumerate((0.0, 4.0, 8.0, 50.0))]
    apart = fuse_points(clouds, FusionSettings(0.1, pass_gap_s=5.0))
    np.testing.assert_allclose(apart.points_m[:, 0], [0.02, 0.04])
    np.testing.assert_array_equal(apart.stamp_s, [0.0, 50.0])  # the nearest view of each
    np.testing.assert_array_equal(apart.pose_index, [0, 3])
    np.testing.assert_array_equal(apart.hits, [3, 1])
    assert apart.colour is None
    assert apart.intensity is None
    merged = fuse_points(clouds, FusionSettings(0.1, pass_gap_s=None))
    np.testing.assert_allclose(merged.points_m, [[0.025, 0.02, 0.03]])
    assert len(fuse_points(clouds, FusionSettings(0.1, pass_gap_s=3.9))) == 4
    assert len(fuse_points(clouds, FusionSettings(0.1, pass_gap_s=4.0))) == 2


def test_what_one_pose_alone_saw_is_left_out_on_demand():
    wall, ghost = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    clouds = [
        PosedCloud(float(row), row, np.eye(4), np.vstack([wall, ghost] if row == 1 else [wall])) for row in range(3)
    ]
    assert len(fuse_points(clouds, FusionSettings(0.1))) == 2
    np.testing.assert_allclose(fuse_points(clouds, FusionSettings(0.1, min_hits=2)).points_m, wall)


def test_points_out_of_range_and_empty_clouds_are_left_out():
    points = np.array([[1.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    empty = PosedCloud(0.0, 0, np.eye(4), np.zeros((0, 3)))
    fused = fuse_points([empty, PosedCloud(0.0, 1, np.eye(4), points)], FusionSettings(0.1, max_range_m=10.0))
    np.testing.assert_allclose(fused.points_m, points[:1])


ONE = PosedCloud(1.0, 4, np.eye(4), np.ones((2, 3)))


@pytest.mark.parametrize(
    ("clouds", "words"),
    [
        ([], "no cloud holds any point"),
        ([ONE, PosedCloud(0.5, 5, np.eye(4), np.ones((1, 3)))], r"pose 5: stamp 0.500000 s comes after 1.000000 s"),
        (
            [ONE, PosedCloud(2.0, 5, np.eye(4), np.ones((1, 3)), np.ones((1, 3), np.uint8))],
            "pose 5: has colours, .*neither",
        ),
        ([PosedCloud(0.0, 3, np.eye(4), np.array([[np.nan, 0.0, 0.0]]))], "pose 3: 1 of 1 points, .*not finite"),
        ([PosedCloud(0.0, 3, np.eye(4), np.array([[0.0, 5e6, 0.0]]))], "Subtract an origin"),
    ],
)
def test_clouds_that_cannot_be_fused_are_refused(clouds, words):
    with pytest.raises(CloudError, match=words):
        fuse_points(clouds)
    with pytest.raises(CloudError, match="expected an edge above 0 m"):
        FusionSettings(voxel_m=0.0)


def test_frames_of_a_room_fuse_to_its_walls_in_their_colours():
    camera, textures = pinhole((0.1, 0.0, 0.2), (0.0, 0.3, 0.0)), walls(0)
    poses = [looking((0.1 * row, 0.0, 0.0), 0.3 * row) for row in range(3)]
    clouds = []
    for row, T in enumerate(poses):
        frame = photograph(textures, T, camera, float(row))
        clouds.append(cloud_of_frame(frame, camera, body_pose(T, camera), row))
    fused = fuse_points(clouds, FusionSettings(0.03))
    assert off_walls_m(fused.points_m).max() < 0.03  # a voxel in a corner holds two walls
    assert np.median(off_walls_m(fused.points_m)) < 1e-6
    points = rigid.apply(clouds[0].T_map_body, clouds[0].points_m)[::50]
    distance = model_distance(points, fused.points_m)
    brute = np.sqrt(((points[:5, None] - fused.points_m[None]) ** 2).sum(axis=2)).min(axis=1)
    np.testing.assert_allclose(distance[:5], brute, rtol=1e-9)
    assert distance.max() < 0.03 * np.sqrt(3.0)
    inside = off_walls_m(points) < 1e-6
    own = fused.colour[np.argmin(((points[inside][:200, None] - fused.points_m[None]) ** 2).sum(axis=2), axis=1)]
    assert np.median(np.abs(own.astype(float) - clouds[0].colour[::50][inside][:200])) < 20.0


def test_colours_are_red_green_blue():
    camera = pinhole()
    frame = photograph(walls(0), looking((0.0, 0.0, 0.0), 0.0), camera)
    frame.image[:] = [255, 100, 7]  # blue first
    assert set(map(tuple, cloud_of_frame(frame, camera, np.eye(4), 0).colour.tolist())) == {(7, 100, 255)}
