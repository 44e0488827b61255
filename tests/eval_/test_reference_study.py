"""The reference study's figures, as far as they can be checked against each other and against the coordinates."""

import numpy as np
import pytest

from eval.collinearity import near_collinear, neighbours
from eval.reference_study import (
    BY_COUNT,
    BY_COUNT_NOTE,
    CONTRAST,
    EFFECT,
    NEAR_COLLINEAR,
    OTHERS_FROM_LINE_M,
    REPEATABILITY,
)
from jaxgeo.simulate.layout import LOCATIONS, SURVEYED_ENH_M, UAV, UGV


@pytest.fixture(scope="module")
def geometry():
    return {each.name: each for each in neighbours(LOCATIONS, SURVEYED_ENH_M)}


def test_distances_from_the_neighbours_line_come_out_to_the_last_digit(geometry):
    for name, (distance_m, share) in NEAR_COLLINEAR.items():
        assert round(100 * geometry[name].distance_m, 1) == round(100 * distance_m, 1)
        assert round(100 * geometry[name].share, 2) == round(100 * share, 2)
    others = [each.distance_m for name, each in geometry.items() if name not in NEAR_COLLINEAR]
    assert (round(100 * min(others)), round(100 * max(others))) == tuple(round(100 * x) for x in OTHERS_FROM_LINE_M)
    assert near_collinear(list(geometry.values())) == set(NEAR_COLLINEAR)


def test_refined_contrasts_average_to_the_refined_means_and_coarse_ones_do_not():
    for place, stages in CONTRAST.items():
        average = {stage: (2 * each.near_m + 4 * each.others_m) / 6 for stage, each in stages.items()}
        assert average["refined"] == pytest.approx(EFFECT[place].loo_mean_m[1], abs=1e-3)
        if place != ("ugv", "dense"):
            assert abs(average["coarse"] / EFFECT[place].loo_mean_m[0] - 1.0) > 0.07
    each = CONTRAST["uav", "icp"]["coarse"]
    assert round(100 * (2 * each.near_m + 4 * each.others_m) / 6, 1) == 421.6


def test_both_sessions_together_are_what_is_reported_by_the_number_of_anchors():
    """Leave one out of the similarity is five of six anchors: the pooled table is the mean of the two sessions'."""
    for trajectory, rows in BY_COUNT.items():
        sessions = [EFFECT[session, trajectory].loo_mean_m[0] for session in ("uav", "ugv")]
        held_out = rows[5].held_out_m
        assert held_out is not None
        assert np.mean(sessions) == pytest.approx(held_out[0], rel=0.02)
        rms = [EFFECT[session, trajectory].loo_rms_m[0] for session in ("uav", "ugv")]
        assert np.mean(rms) == pytest.approx(held_out[1], rel=0.02)
        assert np.sqrt(np.mean(np.square(rms))) > 1.1 * held_out[1]
    rms = [EFFECT[session, "icp"].loo_rms_m[0] for session in ("uav", "ugv")]
    said = (100 * np.mean(rms), 100 * np.sqrt(np.mean(np.square(rms))))
    assert all(f"({value:.0f} cm" in BY_COUNT_NOTE for value in said)


def test_pooled_repeatability_is_that_of_the_visits():
    for name, layout in (("uav", UAV), ("ugv", UGV)):
        *visits, (n, rms_m) = REPEATABILITY[name]
        assert tuple(count for count, _ in visits) == layout.counts
        assert tuple(spread for _, spread in visits) == layout.repeatability_m
        assert sum(layout.counts) == n
        pooled = np.sqrt(np.average(np.square(layout.repeatability_m), weights=layout.counts))
        assert pooled == pytest.approx(rms_m, abs=3e-4)
