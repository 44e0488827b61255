"""Nearest neighbours against all distances at once."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from eval.clouds import nearest_neighbour
from jaxgeo.errors import InputError


def test_as_all_distances_at_once():
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0, 2, (200, 3)), rng.uniform(0, 2, (150, 3))
    nearest_m = cdist(a, b).min(axis=1)
    found = nearest_neighbour(a, b)
    assert found.n == 200
    assert found.mean_m == pytest.approx(nearest_m.mean(), rel=1e-12)
    assert found.median_m == pytest.approx(np.median(nearest_m), rel=1e-12)
    assert found.share_within_30cm == np.mean(nearest_m <= 0.30)
    assert 0.1 < found.share_within_30cm < 0.99
    assert nearest_neighbour(b, a).mean_m != pytest.approx(found.mean_m, rel=1e-3)


def test_a_part_of_a_cloud_lies_on_it_and_not_the_other_way_round():
    cloud = np.random.default_rng(2).uniform(0, 10, (100, 3))
    assert nearest_neighbour(cloud[:20], cloud).mean_m == 0.0
    assert nearest_neighbour(cloud, cloud[:20]).mean_m > 0.1


@pytest.mark.parametrize(
    "bad", [np.zeros((0, 3)), np.zeros((4, 2)), np.full((4, 3), np.nan)], ids=["empty", "flat", "not finite"]
)
def test_unusable_clouds(bad):
    with pytest.raises(InputError, match="the second cloud has shape"):
        nearest_neighbour(np.zeros((1, 3)), bad)
    with pytest.raises(InputError, match="the first cloud has shape"):
        nearest_neighbour(bad, np.zeros((1, 3)))
