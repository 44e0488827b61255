"""Repeatability per visit and pooled over sightings: the study's own sums from its own table."""

import dataclasses

import numpy as np
import pytest
from solve.chain_session import session

from eval.repeatability import pooled_repeatability, repeatability
from jaxgeo.associate import cut_visits, label_visits, make_anchors
from jaxgeo.data import Anchors, Sightings, Survey, Trajectory

VISITS = ("A", "B", "C", "D", "E", "F", "A_revisit")
# As the study prints them: sightings, RMS in cm, of each visit and of all.
STUDY = {
    "UAV": ((152, 289, 167, 209, 197, 185, 175), (14.71, 22.54, 10.94, 6.03, 18.21, 14.43, 7.94), 1374, 15.31),
    "UGV": ((226, 84, 260, 92, 200, 110, 181), (13.76, 37.55, 20.43, 8.11, 15.44, 22.70, 12.22), 1153, 18.79),
}


def anchors_of(count: tuple[int, ...], rms_cm: tuple[float, ...]) -> Anchors:
    made = session(100, len(VISITS), location=("A", "B", "C", "D", "E", "F", "A")).anchors
    return dataclasses.replace(made, label=VISITS, count=np.array(count), repeatability_m=np.array(rms_cm) / 100)


@pytest.mark.parametrize("name", STUDY)
def test_the_studys_sums(name):
    count, rms_cm, total, pooled_cm = STUDY[name]
    found = repeatability(anchors_of(count, rms_cm))
    assert found.count == total
    assert f"{100 * found.rms_m:.2f}" == f"{pooled_cm:.2f}"
    assert [(v.label, v.count, v.rms_m) for v in found.visits] == [
        (label, n, pytest.approx(cm / 100)) for label, n, cm in zip(VISITS, count, rms_cm, strict=True)
    ]
    assert found.visits[-1].location == "A"


def test_sessions_pooled_are_their_sightings_pooled():
    a, b = (repeatability(anchors_of(*STUDY[name][:2])) for name in STUDY)
    both = pooled_repeatability([a, b])
    expected = np.sqrt((a.count * a.rms_m**2 + b.count * b.rms_m**2) / (a.count + b.count))
    assert both.rms_m == pytest.approx(expected, rel=1e-12)
    assert len(both.visits) == 14


def test_the_pooled_value_is_that_of_the_sightings_themselves():
    """Two visits of a body that stands still: the RMS of all sightings, each about its visit's mean."""
    rng = np.random.default_rng(0)
    n = (30, 50)
    stamp_s = np.concatenate([1.0 + 0.1 * np.arange(n[0]), 101.0 + 0.1 * np.arange(n[1])])
    seen_m = [rng.normal([2.0, 0, 0], 0.1, (n[0], 3)), rng.normal([0.0, 3.0, 0], 0.02, (n[1], 3))]
    sightings = Sightings(
        stamp_s=stamp_s,
        marker=np.full(sum(n), ""),
        t_body_marker_m=np.concatenate(seen_m),
        quat_body_marker_wxyz=np.tile([1.0, 0, 0, 0], (sum(n), 1)),
        covariance=np.tile(np.diag([0.01] * 3 + [1e-4] * 3), (sum(n), 1, 1)),
        ambiguous=np.zeros(sum(n), dtype=bool),
        reprojection_px=np.full(sum(n), np.nan),
        source=np.array([f"row {i}" for i in range(sum(n))]),
    )
    survey = Survey(
        name=("A", "B"),
        enh_m=np.array([[2.0, 0, 0], [0, 3.0, 0]]),
        sigma_m=np.full((2, 3), 0.01),
        quat_grid_marker_wxyz=np.full((2, 4), np.nan),
        sigma_rot_rad=np.full((2, 3), np.nan),
        crs="EPSG:2169",
    )
    still = Trajectory(np.linspace(0.0, 200.0, 50), np.zeros((50, 3)), np.tile([1.0, 0, 0, 0], (50, 1)))
    visits, _ = label_visits(cut_visits(sightings, 5.0), survey, order=["A", "B"])
    anchors, _ = make_anchors(still, sightings, visits, survey, origin_enh_m=np.zeros(3))
    about = np.concatenate([x - x.mean(axis=0) for x in seen_m])
    found = repeatability(anchors)
    assert found.rms_m == pytest.approx(np.sqrt(np.mean(np.sum(about**2, axis=1))), rel=1e-9)
    assert found.count == 80


def test_one_sighting_does_not_repeat():
    several, single = (152, 1, 167, 209, 197, 185, 175), (14.71, 0.0, 10.94, 6.03, 18.21, 14.43, 7.94)
    found = repeatability(anchors_of(several, single))
    assert np.isnan(found.visits[1].rms_m)
    assert found.rms_m == pytest.approx(
        np.sqrt(np.average(np.square(single), weights=np.array(several) - (np.arange(7) == 1))) / 100
    )
    assert np.isnan(repeatability(anchors_of((1,) * 7, (0.0,) * 7)).rms_m)
