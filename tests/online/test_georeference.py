"""Pushed piece by piece, a session is at every moment what the batch job makes of what has come so far."""

import dataclasses
import logging
import math

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose
from online.online_session import FRAME, SETTINGS, N, batch_anchors, prefix, push_pose, replayed, session

from jaxgeo.errors import SightingError, TrajectoryError, UndeterminedError
from jaxgeo.graph.noise import odometry_noise
from jaxgeo.online import Labels, OnlineGeoreference
from jaxgeo.online.pose_log import PoseLog
from jaxgeo.solve.correct import Settings, correct

MADE = session()
# Every term of the fixed noise.
NOISE = odometry_noise([0.02, 0.03, 0.025], [0.003, 0.002, 0.004], 0.003, 0.02, 2e-3, 4e-4)


def georeference(**settings) -> OnlineGeoreference:
    return OnlineGeoreference(MADE.survey, FRAME, NOISE, dataclasses.replace(SETTINGS, **settings))


@pytest.fixture(scope="module")
def whole():
    """A warmed session run to its end, and what was compiled on the way."""
    found = georeference()
    found.warm_up()
    compiled: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: compiled.append(record.getMessage())  # type: ignore[method-assign]
    logger = logging.getLogger("jax")
    logger.addHandler(handler)
    try:
        with jax.log_compiles():
            replayed(found, MADE)
            result = found.finish()
    finally:
        logger.removeHandler(handler)
    return found, result, [line for line in compiled if line.startswith("Compiling")]


@pytest.fixture(scope="module")
def batch():
    anchors = batch_anchors(MADE)
    return anchors, correct(MADE.trajectory, anchors, NOISE, Settings())


def test_the_end_is_the_batch_answer(whole, batch):
    _, result, _ = whole
    anchors, expected = batch
    assert result.anchors.label == anchors.label
    assert_allclose(result.anchors.lever_arm_m, anchors.lever_arm_m, atol=1e-12)
    assert_allclose(result.corrected.position_m, expected.corrected.position_m, atol=1e-4)
    assert_allclose(result.covariance, expected.covariance, rtol=1e-4, atol=1e-8)
    assert result.log_scale == pytest.approx(expected.log_scale[0], abs=1e-6)


def test_after_warming_up_nothing_is_compiled(whole):
    assert whole[2] == []


@pytest.mark.parametrize("until", [66, 87, 91])
def test_at_every_moment_it_is_the_batch_answer_so_far(until):
    """Between anchors too: pose and covariance grow with the odometry as the batch solve has them grow."""
    found = georeference()
    solved_at = replayed(found, MADE, until)
    assert until - 1 > solved_at[-1]
    now = found.current()
    expected = correct(prefix(MADE, until), batch_anchors(MADE, until), NOISE, Settings())
    assert now.status == "georeferenced"
    assert now.stamp_s == MADE.trajectory.stamp_s[until - 1]
    assert_allclose(now.position_m, expected.corrected.position_m[-1], atol=2e-4)
    assert_allclose(now.enh_m, now.position_m + FRAME.origin_enh_m)
    assert abs(now.quat_wxyz @ expected.corrected.quat_wxyz[-1]) == pytest.approx(1.0, abs=1e-9)
    sigma = np.sqrt(np.diag(expected.covariance[-1]))
    assert_allclose(
        now.covariance / np.outer(sigma, sigma), expected.covariance[-1] / np.outer(sigma, sigma), atol=2e-3
    )


def test_errors_are_what_the_covariance_says():
    nees = []
    for seed in range(6):
        made = session(seed)
        found = OnlineGeoreference(made.survey, FRAME, NOISE, SETTINGS)
        replayed(found, made, 84)
        now = found.current()
        off = now.position_m - made.truth[83].translation
        nees.append(off @ np.linalg.solve(now.covariance[:3, :3], off))
    assert 0.5 < np.mean(nees) < 8.0


def test_sightings_may_come_late_and_in_any_order(batch):
    rng = np.random.default_rng(3)
    found = georeference()
    order = rng.permutation(len(MADE.sightings))
    early, late = order[:8], order[8:]
    found.push_sightings(MADE.sightings.take(early))  # before the first pose
    for i in range(N):
        push_pose(found, MADE, i)
        found.update()
    found.push_sightings(MADE.sightings.take(late))
    result = found.finish()
    assert_allclose(result.corrected.position_m, batch[1].corrected.position_m, atol=1e-4)
    assert tuple(sorted(result.anchors.count.tolist())) == tuple(sorted(batch[0].count.tolist()))


def test_a_late_sighting_changes_its_anchor():
    found = georeference()
    held_back = np.flatnonzero(MADE.sightings.marker == "B")[-1]
    rest = MADE.sightings.take(np.delete(np.arange(len(MADE.sightings)), held_back))
    replayed(found, dataclasses.replace(MADE, sightings=rest), 56)
    assert found.anchors is not None
    assert found.anchors.count.tolist() == [4, 3, 4]
    found.push_sightings(MADE.sightings.take(np.array([held_back])))
    update = found.update()
    assert update is not None
    assert update.new == ("B",)
    assert found.anchors.count.tolist() == [4, 4, 4]
    assert found.update() is None


def test_before_three_anchors_it_says_what_is_missing():
    found = georeference()
    assert found.current().words.startswith("no anchor yet")
    replayed(found, MADE, 30)
    now = found.current()
    assert (now.status, now.n_anchors) == ("undetermined", 2)
    assert "the 2 anchor(s) at 2 location(s) (A, B)" in now.words
    assert "at least 1 more location(s)" in now.words
    assert np.isnan(now.position_m).all()
    assert found.anchors is not None
    assert now.anchor_age_s == pytest.approx(now.stamp_s - found.anchors.stamp_s[-1])
    with pytest.raises(UndeterminedError, match="do not fix the frame yet"):
        found.finish()
    # What follows is as if nothing had been asked.
    for i in range(30, N):
        found.push_sightings(MADE.sightings.take(np.flatnonzero(MADE.sightings.stamp_s == MADE.trajectory.stamp_s[i])))
        push_pose(found, MADE, i)
        found.update()
    assert found.current().status == "georeferenced"


def test_an_open_visit_can_be_used_at_once():
    found = georeference()
    replayed(found, MADE, 40)
    assert (found.open_visits, found.current().n_anchors) == (1, 2)
    update = found.update(close_open=True)
    assert update is not None
    assert (update.new, update.status) == (("C",), "georeferenced")


@pytest.mark.parametrize(
    ("stamp", "position", "quat", "words"),
    [
        (1.0, (0, 0, 0), (1, 0, 0, 0), "not after the last one"),
        (9.0, (0, math.nan, 0), (1, 0, 0, 0), "not finite"),
        (math.inf, (0, 0, 0), (1, 0, 0, 0), "not finite"),
        (9.0, (0, 0), (1, 0, 0, 0), "2 position and 4 rotation numbers"),
        (9.0, (0, 0, 0), (0, 0, 0, 1.1), "norm 1.1; expected 1"),
        (9.0, (0, 0, 0), (1, 0, 0), "3 position and 3 rotation numbers"),
        (9.0, None, (1, 0, 0, 0), "is no pose"),
    ],
)
def test_a_bad_pose_is_refused_and_forgotten(stamp, position, quat, words):
    found = georeference()
    replayed(found, MADE, 50)
    before = found.current()
    with pytest.raises(TrajectoryError, match=words):
        found.push_odometry(stamp, position, quat)
    assert_allclose(found.current().position_m, before.position_m)
    push_pose(found, MADE, 50)


def test_bad_sightings_are_refused_whole():
    found = georeference()
    some = MADE.sightings.take(np.arange(3))
    for name, value, words in (
        ("stamp_s", np.array([0.0, np.nan, 0.0]), "row 1: sighting of marker 'A' at stamp nan"),
        ("covariance", np.zeros((3, 6, 6)), "not positive definite"),
        ("quat_body_marker_wxyz", np.full((3, 4), 1.0), "not of norm 1"),
        ("marker", np.array(["A", "A", ""]), "marker has no id"),
    ):
        with pytest.raises(SightingError, match=words):
            found.push_sightings(dataclasses.replace(some, **{name: value}))
    with pytest.raises(SightingError, match=r"expected \(3,\)"):
        found.push_sighting(0.0, "A", [1.0, 2.0], np.eye(3))
    assert found.update() is None
    assert found.open_visits == 0


def test_unknown_markers_and_stamps_outside_are_counted():
    found = georeference()
    found.push_sighting(0.5, "X", [1.0, 0.0, 0.0], 1e-4 * np.eye(3))
    found.push_sighting(-5.0, "B", [1.0, 0.0, 0.0], 1e-4 * np.eye(3))
    replayed(found, MADE, 56)
    unknown, outside = found.warnings
    assert unknown == "marker 'X' has no surveyed location; its 1 sighting(s) are left out."
    assert outside.startswith("1 of 17 sightings lie outside the odometry's time, 0.000 to 5.500 s")
    # A visit that is wholly outside still counts as B's first, as in the batch job.
    assert found.anchors is not None
    assert found.anchors.label == ("A", "B_revisit", "C")


def test_by_order_a_visit_too_many_leaves_the_last_answer():
    marker = np.full(len(MADE.sightings), "")
    made = dataclasses.replace(MADE, sightings=dataclasses.replace(MADE.sightings, marker=marker))
    found = georeference(labels=Labels(order=("A", "B", "C")))
    replayed(found, made, 52)
    assert found.current().status == "georeferenced"
    with pytest.raises(SightingError, match=r"4 visits were found but visits.order names 3"):
        replayed_from(found, made, 52, 70)
    stale = found.current()
    assert stale.status == "stale"
    assert np.isfinite(stale.position_m).all()
    with pytest.raises(SightingError, match="4 visits"):
        found.finish()


def replayed_from(found, made, start, until):
    for i in range(start, until):
        found.push_sightings(made.sightings.take(np.flatnonzero(made.sightings.stamp_s == made.trajectory.stamp_s[i])))
        push_pose(found, made, i)
        found.update()


def test_labels_that_the_survey_does_not_have():
    with pytest.raises(SightingError, match="the labels name 'Q'; the survey has A, B, C, D, E"):
        georeference(labels=Labels(locations={"7": "Q"}))


def test_a_solve_that_fails_keeps_the_last_answer(monkeypatch):
    found = georeference()
    replayed(found, MADE, 50)
    solve = found._estimator.solve

    def fails(*arguments, **options):
        return dataclasses.replace(solve(*arguments, **options), converged=False, words="too many steps")

    monkeypatch.setattr(found._estimator, "solve", fails)
    replayed_from(found, MADE, 50, 66)
    now = found.current()
    assert (now.status, now.n_anchors) == ("stale", 4)
    assert "the solve with 4 anchors did not converge: too many steps" in now.words
    assert np.isfinite(now.position_m).all()
    monkeypatch.undo()
    replayed_from(found, MADE, 66, 80)
    assert (found.current().status, found.current().n_anchors) == ("georeferenced", 5)


def test_where_the_last_solution_leads_nowhere_the_coarse_fit_is_tried(monkeypatch):
    found = georeference()
    replayed(found, MADE, 50)
    solve, started = found._estimator.solve, []

    def fails_when_warm(given, last, *, final):
        started.append(("coarse" if last is None else "last", final))
        answer = solve(given, last, final=final)
        return answer if last is None else dataclasses.replace(answer, converged=False)

    monkeypatch.setattr(found._estimator, "solve", fails_when_warm)
    replayed_from(found, MADE, 50, 66)
    assert started == [("last", False), ("coarse", True)]
    assert (found.current().status, found.current().n_anchors) == ("georeferenced", 4)


def test_on_the_way_a_robust_loss_gives_way_to_a_wrong_anchor():
    """As in the batch solve: its weights have settled as well."""
    surveyed = MADE.survey.enh_m.copy()
    surveyed[MADE.survey.index("D")] += [6.0, -8.0, 0.0]
    made = dataclasses.replace(MADE, survey=dataclasses.replace(MADE.survey, enh_m=surveyed))
    settings = Settings(loss="cauchy")
    found = OnlineGeoreference(made.survey, FRAME, NOISE, dataclasses.replace(SETTINGS, solve=settings))
    found.push_sightings(made.sightings)
    for i in range(N):
        push_pose(found, made, i)
    found.update(close_open=True)
    now = found.current()
    expected = correct(made.trajectory, batch_anchors(made), NOISE, settings)
    sigma_m = np.sqrt(np.diag(expected.covariance[-1])[:3])
    assert now.status == "georeferenced"
    assert_allclose(now.position_m / sigma_m, expected.corrected.position_m[-1] / sigma_m, atol=0.1)
    assert_allclose(np.sqrt(np.diag(now.covariance)[:3]), sigma_m, rtol=0.05)


def test_the_end_under_a_robust_loss_starts_as_the_batch_job_does(monkeypatch):
    """A robust loss may hold several optima."""
    found = georeference()
    replayed(found, MADE, 50)
    solve, started = found._estimator.solve, []

    def spied(given, last, *, final):
        started.append((final, last is None))
        return solve(given, last, final=final)

    monkeypatch.setattr(found._estimator, "solve", spied)
    found.finish()
    found.settings = dataclasses.replace(found.settings, solve=Settings(loss="cauchy"))
    found.finish()
    assert started == [(True, False), (True, True)]


def test_beyond_its_capacity_it_grows_and_says_so():
    without_d = MADE.sightings.take(np.flatnonzero(MADE.sightings.marker != "D"))
    made = dataclasses.replace(MADE, sightings=without_d)
    small, roomy = georeference(), georeference()
    small._poses = PoseLog(64)  # buckets begin at 128 poses
    for found in (small, roomy):
        assert len(replayed(found, made, 84)) == 2  # before and after it grows
    assert_allclose(small.current().position_m, roomy.current().position_m, atol=1e-6)
    assert_allclose(small.current().covariance, roomy.current().covariance, rtol=1e-6, atol=1e-12)
    (said,) = small.warnings
    assert said.startswith("more than 64 poses: room for 128 was made")


def test_more_anchors_than_room():
    found = georeference(gap_s=0.05)  # every sighting is a visit
    replayed(found, MADE, 30)
    assert found.current().n_anchors == 8
    (said,) = found.warnings
    assert said.startswith("more than 7 anchors: room for 15 was made")


def test_the_gap_decides_when_a_visit_ends():
    found = georeference(gap_s=3.0)
    replayed(found, MADE, 36)  # A's last sighting at 0.6 s
    assert found.current().n_anchors == 0
    replayed_from(found, MADE, 36, 38)
    assert found.current().n_anchors == 1
    with pytest.raises(SightingError, match=r"gap_s is 0\.0"):
        georeference(gap_s=0.0)
