"""Keyframes along a path."""

import numpy as np

from jaxgeo.data import Trajectory
from jaxgeo.geometry import rigid
from jaxgeo.mapping.keyframes import choose_keyframes


def straight(n: int, step_m: float, step_rad: float = 0.0) -> Trajectory:
    tangent = np.zeros((n, 6))
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, 0, 3] = step_m * np.arange(n)
    tangent[:, 5] = step_rad * np.arange(n)
    T = T @ rigid.exp(tangent)
    return Trajectory(np.arange(n, dtype=float), *rigid.parts(T))


def test_one_as_soon_as_the_distance_is_reached():
    path = straight(21, 0.25)
    found = choose_keyframes(path, path.stamp_s, 1.0, 1.0)
    assert found.source.tolist() == [0, 4, 8, 12, 16, 20]
    assert np.allclose(found.T_map_body[:, 0, 3], [0, 1, 2, 3, 4, 5])


def test_turning_on_the_spot_counts():
    path = straight(11, 0.0, 0.1)
    assert choose_keyframes(path, path.stamp_s, 1.0, 0.29).source.tolist() == [0, 3, 6, 9]


def test_standing_still_is_one_keyframe():
    path = straight(50, 0.0)
    assert len(choose_keyframes(path, path.stamp_s, 0.5, 0.3)) == 1


def test_stamps_between_poses_are_interpolated():
    path = straight(3, 1.0)
    found = choose_keyframes(path, np.array([0.5, 1.75]), 0.5, 1.0)
    assert np.allclose(found.T_map_body[:, 0, 3], [0.5, 1.75])
