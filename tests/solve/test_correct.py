"""The entry point: what it returns, what it refuses, and in which words."""

import dataclasses
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from solve.chain_session import NOISE, anchors_at, session, transforms, walk

from jaxgeo.data import Anchors
from jaxgeo.errors import ConvergenceError, SightingError, UndeterminedError
from jaxgeo.solve.correct import Settings, correct

N = 100


def on_points(points_m: np.ndarray, location: tuple[str, ...] | None = None, sigma_m: float = 0.01) -> Anchors:
    """Anchors at these positions, whatever the trajectory says: the lever arms reach there from the true poses."""
    truth = walk(N)
    made = anchors_at(truth, np.linspace(0, N - 1, len(points_m)).astype(int), sigma_m=sigma_m, location=location)
    lever = truth[made.pose_index].inv().apply(points_m)
    return dataclasses.replace(made, lever_arm_m=lever, surveyed_enh_m=points_m)


CENTRE = np.array([430.0, -190.0, 50.0])
ALONG = np.array([0.6, 0.8, 0.0])
LINE = CENTRE + np.linspace(-20.0, 20.0, 4)[:, None] * ALONG


def test_a_good_session_is_brought_to_the_truth():
    made = session(N, 7, lever_m=1.0, sigma_m=0.01)
    found = correct(made.trajectory, made.anchors, NOISE, Settings())
    assert found.result == "converged"
    assert found.corrected.stamp_s is made.trajectory.stamp_s
    off = found.corrected.position_m - made.truth.position_m
    coarse = found.coarse.position_m - made.truth.position_m
    assert np.sqrt(np.mean(off**2)) < 0.5 * np.sqrt(np.mean(coarse**2))
    # Errors are what the covariances say, of position and of rotation.
    turn = transforms(found.corrected).rotation * transforms(made.truth).rotation.inv()
    error = np.concatenate([off, turn.as_rotvec()], axis=1)
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    assert 2.0 < nees.mean() < 12.0
    assert_allclose(found.covariance, np.swapaxes(found.covariance, 1, 2))
    assert np.all(found.bias == 0.0)
    assert found.log_scale == (0.0, 0.0)


@pytest.mark.parametrize(
    ("points", "location", "words"),
    [
        (LINE[[0, 3]], ("A", "B"), r"the 2 anchors at 2 location\(s\) \(A, B\)"),
        (LINE, ("A", "B", "C", "D"), r"the 4 anchors at 4 location\(s\) \(A, B, C, D\)"),
        (LINE[[0, 3, 0, 3]], ("A", "B", "A", "B"), r"the 4 anchors at 2 location\(s\) \(A, B\)"),
    ],
    ids=["two", "four on a line", "two visited twice"],
)
def test_anchors_on_a_line_leave_the_turn_about_it(points, location, words):
    made = session(N, 7)
    with pytest.raises(UndeterminedError, match=words) as caught:
        correct(made.trajectory, on_points(points, location), NOISE, Settings())
    named = re.search(r"the turn about the direction \(E (\S+), N (\S+), h (\S+)\)", str(caught.value))
    assert named is not None
    axis = np.array([float(v) for v in named.groups()])
    assert abs(axis @ ALONG) > 0.99
    assert caught.value.exit_code == 3


def test_one_location_visited_thrice():
    made = session(N, 7)
    anchors = on_points(LINE[[0, 0, 0]], ("A", "A", "A"))
    with pytest.raises(UndeterminedError, match=r"the 3 anchors at 1 location\(s\) \(A\)") as caught:
        correct(made.trajectory, anchors, NOISE, Settings())
    assert "wholly free" in str(caught.value)


@pytest.mark.parametrize("aside_m", [0.5, 2.0])
def test_nearly_on_a_line_is_enough(aside_m):
    """Half a metre off a line of 40 m, known to a centimetre."""
    aside = np.zeros((4, 3))
    aside[1, 2], aside[2, :2] = aside_m, aside_m * np.array([-0.8, 0.6])
    made = session(N, 7)
    found = correct(made.trajectory, on_points(LINE + aside), NOISE, Settings())
    assert found.result == "converged"
    assert np.degrees(found.fold.gauge_sigma.max()) < 3.0


def test_a_grossly_wrong_anchor_is_refused_by_name():
    """Twenty metres, where drift and survey are of centimetres."""
    made = session(N, 7, lever_m=1.0)
    surveyed = made.anchors.surveyed_enh_m.copy()
    surveyed[3] += [12.0, -16.0, 0.0]
    wrong = dataclasses.replace(made.anchors, surveyed_enh_m=surveyed)
    with pytest.raises(ConvergenceError, match=r"did not converge: .* after \d+ of 50 steps") as caught:
        correct(made.trajectory, wrong, NOISE, Settings())
    assert "visit 'visit3' is farthest off" in str(caught.value)
    assert caught.value.exit_code == 3


def test_rotations_that_nobody_measured():
    made = session(N, 7)
    with pytest.raises(SightingError, match="none of the 7 anchors has a rotation"):
        correct(made.trajectory, made.anchors, NOISE, Settings(use_rotation=True))


def test_half_a_turn_of_the_map_is_taken_by_the_coarse_fit():
    made = session(N, 7, lever_m=1.0)
    turn = Rotation.from_euler("z", 180.0, degrees=True)
    poses = transforms(made.trajectory)
    turned = dataclasses.replace(
        made.trajectory,
        position_m=turn.apply(poses.translation),
        quat_wxyz=(turn * poses.rotation).as_quat(scalar_first=True),
    )
    straight, bent = (correct(t, made.anchors, NOISE, Settings()) for t in (made.trajectory, turned))
    assert_allclose(straight.corrected.position_m, bent.corrected.position_m, rtol=0, atol=1e-9)
