"""The similarity to first visits alone: against the choices of all but one, and a plain fit."""

import dataclasses

import numpy as np
import pytest
from eval_.small_problem import SETTINGS, problem
from eval_.test_oracles import umeyama_loop
from scipy.spatial.transform import Rotation

from eval.first_visits import first_visits
from eval.subsets import similarity_subsets


def test_held_out_errors_are_those_of_all_choices_but_one():
    trajectory, anchors = problem()
    found = first_visits(trajectory, anchors, SETTINGS)
    assert found is not None
    (choices,) = similarity_subsets(trajectory, anchors, SETTINGS, [5], visits="first")
    for used, error_m in zip(choices.used, choices.held_out_m, strict=True):
        (out,) = np.flatnonzero(~used)
        name = anchors.location[int(np.flatnonzero(anchors.location_index == out)[0])]
        assert found.held_out_m[name] == pytest.approx(np.nanmax(error_m), rel=1e-12)


def test_the_revisit_gap_is_that_of_a_fit_which_does_not_know_the_second_visit():
    trajectory, anchors = problem()
    anchors = dataclasses.replace(anchors, lever_arm_m=anchors.lever_arm_m + np.eye(7)[:, [6]] * [30.0, 0.0, 0.0])
    body = Rotation.from_quat(trajectory.quat_wxyz[anchors.pose_index], scalar_first=True)
    marker_m = trajectory.position_m[anchors.pose_index] + body.apply(anchors.lever_arm_m)
    scale, turn, shift = umeyama_loop(marker_m[:6], anchors.surveyed_enh_m[:6], True)
    fitted = scale * marker_m @ turn.T + shift
    found = first_visits(trajectory, anchors, SETTINGS)
    assert found is not None
    assert found.revisit_m == {"A": pytest.approx(np.linalg.norm(fitted[6] - fitted[0]), rel=1e-9)}
    assert found.revisit_m["A"] > 15.0


def test_without_revisits_there_is_nothing_to_tell():
    trajectory, anchors = problem()
    fields = {f.name: getattr(anchors, f.name) for f in dataclasses.fields(anchors)}
    once = type(anchors)(**{name: value[:6] for name, value in fields.items()})
    assert first_visits(trajectory, once, SETTINGS) is None
