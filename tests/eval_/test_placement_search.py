"""Layouts found by gradient against those found by trying; the whole answer."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from eval_.placement_problem import loop, one_set, small_problem

from eval.placement.candidates import along_path, candidates_along, equal_spacing, is_closed, most_passes
from eval.placement.gradient_search import SearchSettings, gradient_search
from eval.placement.known_visits import candidate_visits
from eval.placement.planned import PlacementInput, place_anchors, predict_layout
from eval.placement.problem import accuracy, without_standing
from eval.placement.subset_search import best_subset, exchanged, greedy_subset, subset_values
from jaxgeo.errors import InputError

QUICK = SearchSettings(starts=8, subsets=128, exchanged=1, steps=40, batch=8)
GIVEN = PlacementInput(
    counts=(3,),
    range_m=6.0,
    sighting_sigma_m=0.05,
    survey_sigma_m=(0.02, 0.02, 0.02),
    apart_m=12.0,
    reach_m=4.0,
    starts=8,
    watched=16,
    exhaustive=600,
)


@pytest.fixture(scope="module")
def problem():
    return small_problem()


def test_gradient_reaches_the_best_of_a_grid_and_beats_equal_spacing(problem):
    _, best = best_subset(candidate_visits(candidates_along(problem, 16), problem), 3)
    found = gradient_search(3, problem, QUICK)
    assert found.value_m[0] <= 1.005 * best
    assert found.value_m[0] < float(accuracy(jnp.asarray(equal_spacing(3, problem)), problem))
    assert float(accuracy(jnp.asarray(found.point_m[0]), problem)) == pytest.approx(found.value_m[0], rel=1e-9)
    away = np.linalg.norm(found.point_m[0][:, None, :2] - np.asarray(problem.plan.position_m)[None, :, :2], axis=-1)
    assert away.min(axis=1).max() < 4.0 + 1.0


def test_subsets_are_judged_as_layouts_are(problem):
    candidate = candidates_along(problem, 12)
    rows = np.array([[0, 4, 8], [1, 2, 3], [2, 6, 11]])
    found = subset_values(candidate_visits(candidate, problem), rows)
    alone = [float(accuracy(jnp.asarray(candidate[row]), problem)) for row in rows]
    np.testing.assert_allclose(found, alone, rtol=1e-9)
    standing = eqx.tree_at(lambda p: p.standing_m, problem, jnp.asarray(candidate[8:9]))
    known = candidate_visits(candidate, standing)
    np.testing.assert_allclose(subset_values(known, rows[:1, :2]), found[:1], rtol=1e-9)
    assert without_standing(standing).standing_m.shape == (0, 3)


def test_best_greedy_and_exchange_agree_with_trying_all(problem):
    known = candidate_visits(candidates_along(problem, 12), problem)
    every = np.array(list(itertools.combinations(range(12), 3)))
    values = subset_values(known, every)
    rows, value = best_subset(known, 3)
    assert value == pytest.approx(values.min())
    np.testing.assert_array_equal(rows, every[np.argmin(values)])
    np.testing.assert_array_equal(greedy_subset(known, 3)[0], rows)
    four, greedy = greedy_subset(known, 4)
    improved, better = exchanged(known, four)
    assert better <= greedy < value
    assert len(set(improved.tolist())) == 4


def test_equal_spacing_is_equal(problem):
    assert is_closed(problem.plan)
    turned = equal_spacing(4, problem, first=0.1)
    np.testing.assert_allclose(turned, along_path(problem, np.array([0.1, 0.35, 0.6, 0.85])))
    assert most_passes(problem) == 2


@pytest.mark.parametrize(("count", "message"), [(2, "three or more"), (0, "one or more")])
def test_too_few_markers(problem, count, message):
    with pytest.raises(InputError, match=message):
        gradient_search(count, problem, QUICK)


@pytest.fixture(scope="module")
def answer():
    return place_anchors(loop(), one_set(), GIVEN)[0]


def test_the_answer_compares_and_says_what_if(answer, subtests):
    chosen = answer.chosen
    methods = {layout.method: layout.accuracy_m["path"] for layout in answer.layouts}
    with subtests.test("best first"):
        assert set(methods) == {"gradient", "greedy", "exhaustive", "equal spacing"}
        assert chosen.accuracy_m["path"] == min(methods.values())
    with subtests.test("names and visits along the path"):
        assert chosen.name == ("P1", "P2", "P3")
        assert [v.distance_m for v in chosen.visits] == sorted(v.distance_m for v in chosen.visits)
        assert {v.location for v in chosen.visits} == set(chosen.name)
    changes = {(w.change, w.marker): w for w in answer.what_if}
    with subtests.test("one more helps, one of three lost frees the frame"):
        assert changes["one more", ""].accuracy_m < chosen.accuracy_m["path"]
        assert changes["one lost", "P1"].accuracy_m == np.inf
    with subtests.test("coming back and measuring better help"):
        for change in (("revisit", "P2"), ("better survey", ""), ("longer dwell", "")):
            assert changes[change].accuracy_m < chosen.accuracy_m["path"]
        assert changes["revisit", "P2"].further_m > 0.0
    with subtests.test("everything together decides"):
        s = answer.sensitivity
        # All lengths and sigmas of one unit: scaled together, the criterion scales.
        total = s.survey_sigma + s.sighting_sigma + sum(s.noise.values())
        assert total == pytest.approx(1.0, abs=1e-6)
        assert s.position_per_m.shape == (3, 2)


def test_only_candidates_and_standing_markers():
    problem = small_problem()
    candidate = along_path(problem, np.arange(8) / 8)
    names = tuple(f"T{i}" for i in range(8))
    given = {"candidate_m": candidate[1:], "candidate_name": names[1:], "counts": (2,)}
    standing = {"standing_m": candidate[:1], "standing_name": names[:1]}
    found = place_anchors(loop(), one_set(), PlacementInput(**(GIVEN.__dict__ | given | standing)))[0]
    assert {layout.method for layout in found.layouts} == {"exhaustive", "greedy", "equal spacing"}
    assert found.chosen.standing == (False, False, True)
    assert found.chosen.name[2] == "T0"
    assert set(found.chosen.name[:2]) < set(names[1:])
    same = predict_layout(loop(), one_set(), GIVEN, found.chosen.point_m, found.chosen.name)
    assert same.chosen.accuracy_m == pytest.approx(found.chosen.accuracy_m)
    with pytest.raises(InputError, match="no more than these"):
        place_anchors(loop(), one_set(), PlacementInput(**(GIVEN.__dict__ | given | {"counts": (9,)})))
