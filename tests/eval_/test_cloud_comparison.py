"""Comparison of clouds: both ways against all distances at once; medians of cells; thinning."""

import numpy as np
from scipy.spatial.distance import cdist

from eval.cloud_comparison import compare_clouds, distance_map, thinned
from eval.figures.cloud_distance import distance_histogram_figure, distance_map_figure


def two_clouds() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.uniform(0, 4, (300, 3)), rng.uniform([1, 0, 0], [5, 4, 4], (200, 3))


def test_both_ways_as_all_distances_at_once():
    a, b = two_clouds()
    found, every = compare_clouds(a, b), cdist(a, b)
    np.testing.assert_allclose(found.a_to_b_m, every.min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(found.b_to_a_m, every.min(axis=0), rtol=1e-12)
    assert found.a_to_b.n == 300
    assert found.b_to_a.median_m == np.median(every.min(axis=0))


def test_a_map_has_the_median_of_every_cell():
    a, _ = two_clouds()
    distance = np.random.default_rng(4).gamma(1.0, size=len(a))
    found = distance_map(a - [7.3, 2.1, 0.0], distance, 0.5)
    np.testing.assert_allclose(found.low_m % 0.5, 0.0, atol=1e-12)
    at = np.floor((a[:, :2] - [7.3, 2.1] - found.low_m) / 0.5).astype(int)
    for row in range(found.median_m.shape[0]):
        for column in range(found.median_m.shape[1]):
            inside = (at == [column, row]).all(axis=1)
            expected = np.median(distance[inside]) if inside.any() else np.nan
            np.testing.assert_allclose(found.median_m[row, column], expected)
    assert np.isnan(found.median_m).sum() < found.median_m.size


def test_thinning_keeps_the_first_point_of_every_voxel():
    a, _ = two_clouds()
    kept = thinned(a - 2.0, 0.7)
    voxel = [tuple(v) for v in np.floor((a - 2.0) / 0.7).astype(int)]
    assert kept.tolist() == [i for i, v in enumerate(voxel) if v not in voxel[:i]]
    assert 50 < len(kept) < 290


def test_figures_are_drawn_the_same_every_time():
    a, b = two_clouds()
    found = compare_clouds(a, b)
    origin = np.array([79000.0, 76000.0, 0.0])

    def drawn() -> tuple[bytes, bytes]:
        chart = distance_map_figure(distance_map(a, found.a_to_b_m, 0.5), "one", "two", origin)
        return chart.svg(), distance_histogram_figure({"a": found.a_to_b_m, "b": found.b_to_a_m}).svg()

    first, second = drawn(), drawn()
    assert first == second
    assert b"79\xe2\x80\xaf000" in first[0]
    assert b"nearest point of two" in first[0]
