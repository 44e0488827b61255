"""The descriptor of places."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxgeo.mapping.scan_context import SECTORS, context_distance, scan_context, scan_contexts


def place(seed: int) -> np.ndarray:
    """Posts of various heights on a ground, in the middles of the bins, so that a turn by sectors changes no bin."""
    rng = np.random.default_rng(seed)
    heading = 2 * np.pi * (rng.integers(0, SECTORS, 200) + 0.5) / SECTORS
    distance, height = rng.uniform(1.0, 19.0, 200), rng.uniform(0.5, 6.0, 200)
    ground = np.zeros(200)
    xy = np.column_stack([distance * np.cos(heading), distance * np.sin(heading)])
    return np.concatenate([np.column_stack([xy, height]), np.column_stack([xy, ground])])


@pytest.mark.parametrize("sectors", [0, 1, 14, 31, 59])
def test_a_turned_place_is_the_same_place_and_the_turn_is_found(sectors):
    yaw = 2 * np.pi * sectors / SECTORS
    first = place(1)
    second = first @ Rotation.from_euler("z", yaw).as_matrix()  # seen from a frame turned by the yaw
    a, b = scan_context(first, 20.0), scan_context(second, 20.0)
    distance, found = context_distance(a, b)
    assert distance == pytest.approx(0.0, abs=1e-9)
    assert np.cos(found - yaw) == pytest.approx(1.0, abs=1e-9)
    keys = scan_contexts([a, b]).ring_key
    assert np.allclose(keys[0], keys[1])


def test_other_places_are_far():
    a, b = (scan_context(place(seed), 20.0) for seed in (1, 2))
    assert context_distance(a, b)[0] > 0.4


def test_heights_count_from_the_ground_wherever_the_sensor_is():
    assert np.allclose(scan_context(place(1) - [0, 0, 1.7], 20.0), scan_context(place(1), 20.0))


def test_an_empty_place_is_like_nothing():
    empty = scan_context(np.zeros((0, 3)), 20.0)
    assert context_distance(empty, scan_context(place(1), 20.0))[0] == 1.0
    assert context_distance(empty, empty)[0] == 1.0
