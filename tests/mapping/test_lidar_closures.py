"""Verification of loops between submaps: what is one place, what is not, and what cannot be told."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from walled_loop import RANGE_M, walk, world

from jaxgeo.geometry import rigid
from jaxgeo.mapping.closure import Closure
from jaxgeo.mapping.closure_noise import registration_covariance, weakest_direction
from jaxgeo.mapping.lidar_closures import LidarPlace, VerificationSettings, lidar_closures, lidar_place, verify
from jaxgeo.mapping.loop_candidates import LoopCandidate
from jaxgeo.odometry.registration import Registration

SETTINGS = VerificationSettings()
VOXEL_M = 0.15


@pytest.fixture(scope="module")
def court() -> np.ndarray:
    return world(np.random.default_rng(3))


def place_at(T: np.ndarray, points_m: np.ndarray, seed: int) -> LidarPlace:
    rng = np.random.default_rng(seed)
    seen = rigid.apply(rigid.inverse(T), points_m)
    seen = seen[(np.linalg.norm(seen, axis=1) < RANGE_M) & (rng.random(len(seen)) < 0.5)]
    return lidar_place(seen + 0.01 * rng.normal(size=seen.shape), VOXEL_M, SETTINGS)


def candidate(*starts: np.ndarray) -> LoopCandidate:
    return LoopCandidate(0, 1, np.stack(starts), False)


def test_a_place_seen_twice_is_found_from_a_poor_start(court):
    first = walk()[12]
    second = first @ rigid.exp(np.array([0.6, 0.3, 0.0, 0.0, 0.02, 0.7]))
    truth = rigid.inverse(first) @ second
    start = truth @ rigid.exp(np.array([0.5, -0.4, 0.1, 0.03, 0.0, 0.2]))
    found = verify(candidate(start), place_at(first, court, 1), place_at(second, court, 2), SETTINGS)
    assert isinstance(found, Closure)
    error = rigid.log(rigid.inverse(found.T_first_second) @ truth)
    print("error", error, "score", found.score)
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(error[3:]) < 0.005
    assert error @ found.information @ error < 22.5
    assert np.allclose(found.information, found.information.T)
    assert (np.linalg.eigvalsh(found.information) > 0).all()


def test_another_place_is_refused(court):
    T = walk()[12]
    rng = np.random.default_rng(9)
    hill = rng.uniform(-RANGE_M, RANGE_M, (6000, 2))
    other = rigid.apply(T, np.column_stack([hill, 0.5 * np.sin(hill[:, 0]) + 0.4 * np.cos(1.3 * hill[:, 1]) - 1.0]))
    starts = [rigid.exp(np.array([0, 0, 0, 0, 0, yaw])) for yaw in (0.0, 1.5)]
    assert verify(candidate(*starts), place_at(T, court, 1), place_at(T, other, 2), SETTINGS) == "no agreement"


def test_a_bare_corridor_is_ambiguous():
    along, up = (grid.ravel() for grid in np.meshgrid(np.arange(-12, 12, 0.08), np.arange(0, 2.5, 0.08)))
    walls = [np.column_stack([along, np.full(len(along), side), up]) for side in (-1.0, 1.0)]
    floor = np.column_stack([along, np.clip(up - 1.25, -1, 1), np.zeros(len(along))])
    corridor = np.concatenate([*walls, floor])
    T = rigid.exp(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    found = verify(candidate(np.eye(4)), place_at(T, corridor, 1), place_at(T, corridor, 2), SETTINGS)
    assert found == "ambiguous"


def test_refusals_are_counted_and_small_clouds_named(court):
    T = walk()[12]
    places = [place_at(T, court, 1), place_at(T, court, 2), None]
    candidates = [candidate(np.eye(4)), LoopCandidate(0, 2, np.eye(4)[None], False)]
    calls = []
    found, refused = lidar_closures(candidates, places.__getitem__, on_progress=lambda *done: calls.append(done))
    assert len(found) == 1
    assert refused == {"too few points": 1}
    assert calls == [(1, 2), (2, 2)]


def test_covariance_keeps_the_weak_direction_and_the_floor():
    turn = Rotation.from_euler("z", 0.4).as_matrix()
    strength = np.array([1.0, 1e3, 1e3, 1e4, 1e4, 1e4])
    information = np.diag(strength)
    information[:3, :3] = turn @ np.diag(strength[:3]) @ turn.T
    found = Registration(np.eye(4), 1.0, 0.1, 200.0 * information, True)
    covariance = registration_covariance(found, 200, 0.02, 0.003)
    assert np.allclose(np.abs(weakest_direction(found)), np.abs(turn[:, 0]))
    along = turn[:, 0] @ covariance[:3, :3] @ turn[:, 0]
    across = turn[:, 1] @ covariance[:3, :3] @ turn[:, 1]
    assert along == pytest.approx(1.0 / 100 + 0.02**2)
    assert across == pytest.approx(1e-3 / 100 + 0.02**2)
    assert covariance[4, 4] > 0.003**2
