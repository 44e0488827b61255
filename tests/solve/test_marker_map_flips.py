"""A marker in the wrong one of its two minima: where the joint solve leaves it, and that it is found out."""

import equinox as eqx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxgeo.data import CornerSightings
from jaxgeo.solve.marker_map import _poses, _problem, _solve, _with_flips, build_marker_map
from jaxgeo.solve.marker_map_flips import flips
from jaxgeo.solve.marker_map_inputs import MapSettings, map_inputs
from jaxgeo.solve.marker_map_start import Poses, starting_poses
from tests.solve.marker_room import N_IMAGES, room_rig, sighted

SMALL_M = 0.06
NOISE_PX = 0.3
SETTINGS = MapSettings(floor_px=0.0, origin="m0")


@pytest.fixture(scope="module")
def seen_twice() -> CornerSightings:
    """Small markers; the last is seen from the side, in two images: both its poses explain them nearly as well."""
    corners, _, _ = sighted(room_rig(), NOISE_PX, side_m=SMALL_M)
    rows = np.flatnonzero((corners.marker != "m4") | np.isin(corners.stamp_s, [8.0, 9.0]))
    return CornerSightings(
        corners.stamp_s[rows],
        corners.camera[rows],
        corners.marker[rows],
        corners.corners_px[rows],
        corners.source[rows],
    )


def turned_rad(first: np.ndarray, second: np.ndarray) -> float:
    return float(Rotation.from_matrix(first.T @ second).magnitude())


def test_a_marker_in_its_wrong_minimum_is_turned_back(seen_twice):
    inputs = map_inputs(seen_twice, room_rig(), SMALL_M, NOISE_PX, SETTINGS)
    images, markers = starting_poses(inputs.candidates, N_IMAGES, 5, inputs.origin)
    problem = _problem(inputs, images, markers, np.zeros(5), 1.0, SETTINGS)
    right, _ = _with_flips(_solve(problem, 100), problem, inputs, SETTINGS)
    images, markers = _poses(right.point, inputs)
    other = next(flip for flip in flips(inputs.candidates, images, markers, inputs.origin) if flip.row == 4)
    assert not other.of_image
    mirrored = Poses(markers.R.copy(), markers.t.copy())
    mirrored.R[4], mirrored.t[4] = other.R, other.t
    there = eqx.tree_at(lambda p: p.base, problem, _problem(inputs, images, mirrored, np.zeros(5), 1.0, SETTINGS).base)
    wrong = _solve(there, 100)
    # A minimum of its own: the solve alone does not leave it.
    assert turned_rad(_poses(wrong.point, inputs)[1].R[4], markers.R[4]) > 0.5
    assert float(wrong.cost) > 1.001 * float(right.cost)
    found, fell = _with_flips(wrong, problem, inputs, SETTINGS)
    assert fell
    assert float(found.cost) == pytest.approx(float(right.cost), rel=1e-8)
    assert turned_rad(_poses(found.point, inputs)[1].R[4], markers.R[4]) < 1e-4
    assert int(found.steps) > int(wrong.steps)


def test_at_the_best_minimum_nothing_falls(seen_twice):
    inputs = map_inputs(seen_twice, room_rig(), SMALL_M, NOISE_PX, SETTINGS)
    images, markers = starting_poses(inputs.candidates, N_IMAGES, 5, inputs.origin)
    problem = _problem(inputs, images, markers, np.zeros(5), 1.0, SETTINGS)
    best, _ = _with_flips(_solve(problem, 100), problem, inputs, SETTINGS)
    again, fell = _with_flips(best, problem, inputs, SETTINGS)
    assert not fell
    assert float(again.cost) == float(best.cost)


def test_the_map_has_the_true_pose(seen_twice):
    found = build_marker_map(seen_twice, room_rig(), SMALL_M, NOISE_PX, SETTINGS)
    _, (R_true, _), _ = sighted(room_rig(), side_m=SMALL_M)
    R = Rotation.from_quat(found.quat_wxyz, scalar_first=True)
    assert (R * R_true.inv()).magnitude().max() < 0.3
