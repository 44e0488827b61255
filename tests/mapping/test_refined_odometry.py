"""Scans of neighbouring keyframes check the odometry."""

import functools

import numpy as np
import pytest
from walled_loop import scans_of, walk, world

from jaxgeo.geometry import rigid
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.mapping.keyframe_graph import edge_covariance
from jaxgeo.mapping.lidar_closures import LidarPlace, VerificationSettings, lidar_place
from jaxgeo.mapping.refined_odometry import refine_odometry
from jaxgeo.solve.closure_graph import ClosureSettings

SETTINGS = VerificationSettings(floor_m=0.005, floor_rad=0.001)
GNC = ClosureSettings(loss="gnc", loss_width=4.1, start="given")


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return walk()[::2][:12]


@pytest.fixture(scope="module")
def place(truth):
    rng = np.random.default_rng(3)
    scans = scans_of(truth, world(rng), rng)

    @functools.cache
    def prepared(k: int) -> LidarPlace:
        return lidar_place(scans[k].points_m, 0.15, SETTINGS)

    return prepared


def broken(truth: np.ndarray) -> np.ndarray:
    """Odometry that jumps by 0.7 m and 0.25 rad between keyframes 5 and 6."""
    odometry = truth.copy()
    odometry[6:] = truth[5] @ rigid.exp(np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.25])) @ rigid.inverse(truth[5]) @ truth[6:]
    return odometry


def refined(odometry: np.ndarray, place):
    n = len(odometry)
    covariance = edge_covariance(default_noise("lidar"), np.full(n - 1, 0.8), np.zeros(n - 1))
    return covariance, refine_odometry(odometry, covariance, place, SETTINGS, GNC)


def test_a_jump_is_disproved_and_mended(truth, place):
    covariance, found = refined(broken(truth), place)
    assert found.disproved.tolist() == [5]
    assert np.linalg.norm(found.T_map_body[-1, :3, 3] - truth[-1, :3, 3]) < 0.1
    assert np.linalg.norm(broken(truth)[-1, :3, 3] - truth[-1, :3, 3]) > 0.6
    assert found.covariance[5, 0, 0] > 100 * covariance[5, 0, 0]
    assert np.array_equal(np.delete(found.covariance, 5, axis=0), np.delete(covariance, 5, axis=0))


def test_good_odometry_is_left_alone(truth, place):
    covariance, found = refined(truth, place)
    assert found.disproved.size == 0
    assert np.array_equal(found.covariance, covariance)
    assert len(found.neighbours) > len(truth)
    assert np.abs(found.T_map_body - truth).max() < 0.02


def test_without_clouds_the_odometry_stays(truth):
    _, found = refined(broken(truth), lambda k: None)
    assert np.array_equal(found.T_map_body, broken(truth))
    assert len(found.neighbours) == 0
