"""Plans: waypoints filled in, visits found, ways back added, places allowed."""

import jax.numpy as jnp
import numpy as np
import pytest
from eval_.placement_problem import SIGHT, loop, one_set, small_plan, two_sets

from eval.placement.noise_sets import few_sets
from eval.placement.plan import densified, extended_plan, place_at_distance, place_at_stamp, plan_of, position_at
from eval.placement.plan_drift import carried, covariance_of, own_covariance
from eval.placement.plan_visits import distance_of, plan_visits
from eval.placement.region import placed, region_of
from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError, TrajectoryError
from jaxgeo.graph.components import NoiseEnsemble


def test_waypoints_drift_like_the_way_between_them():
    corners = np.array([[0.0, 0.0, 0.0], [40.0, 0.0, 0.0], [40.0, 30.0, 2.0]])
    straight = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    few = plan_of(Trajectory(np.array([0.0, 40.0, 70.0]), corners, straight))
    share = np.linspace(0.0, 2.0, 701)
    many = Trajectory(
        np.interp(share, np.arange(3), [0.0, 40.0, 70.0]),
        np.column_stack([np.interp(share, np.arange(3), axis) for axis in corners.T]),
        np.tile(straight[0], (701, 1)),
    )
    many = plan_of(many)
    for plan in (few, many):
        assert float(plan.distance_m[-1]) == pytest.approx(70.07, rel=0.02)
        np.testing.assert_allclose(
            position_at(plan, place_at_stamp(plan, jnp.array([20.0])))[0], [20.0, 0.0, 0.0], atol=0.1
        )
    np.testing.assert_allclose(few.white[:, -1], many.white[:, -1], rtol=0.02, atol=1e-6 * np.abs(many.white).max())


def test_a_dense_path_is_left_as_it_is():
    path = loop()
    assert densified(path) is path


@pytest.mark.parametrize("still", [1, 5])
def test_a_path_has_to_move(still):
    stamps = np.arange(float(still))
    with pytest.raises(TrajectoryError, match="goes nowhere"):
        plan_of(Trajectory(stamps, np.ones((still, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (still, 1))))


def test_covariances_are_covariances():
    plan, noise = small_plan(wanders=True), two_sets()
    place = jnp.array([3.0, 50.25, 90.5, 126.0])
    points = carried(plan, noise, place, position_at(plan, place))
    whole = np.asarray(covariance_of(points, points, plan, noise))
    assert np.linalg.eigvalsh(whole).min() > -1e-9
    np.testing.assert_allclose(whole, np.swapaxes(whole, 1, 2), atol=1e-12)
    blocks = whole.reshape(2, 4, 3, 4, 3)[:, np.arange(4), :, np.arange(4)]
    np.testing.assert_allclose(np.swapaxes(blocks, 0, 1), own_covariance(points, plan, noise), atol=1e-12)


def test_a_marker_is_visited_once_a_pass():
    plan = small_plan()
    start = np.asarray(position_at(plan, place_at_distance(plan, jnp.array([0.0, 0.4, 0.7]) * plan.distance_m[-1])))
    seen = plan_visits(jnp.asarray(start + np.array([0.5, 0.5, 0.0])), plan, SIGHT)
    # The path ends where it starts: two passes there.
    np.testing.assert_array_equal((np.asarray(seen.seen).reshape(3, -1) > 0.0).sum(axis=1), [2, 1, 1])
    at = np.asarray(distance_of(seen, plan)).reshape(3, -1)[1:, 0]
    np.testing.assert_allclose(at, np.array([0.4, 0.7]) * float(plan.distance_m[-1]), atol=1.0)
    assert not np.any(plan_visits(jnp.asarray([[100.0, 0.0, 0.0]]), plan, SIGHT).seen)


def test_the_way_back_is_added_behind_the_path():
    path, plan = loop(), small_plan()
    longer = extended_plan(path, np.array([-10.0, 5.0, 1.0]), plan)
    n = len(plan)
    for name in ("position_m", "stamp_s", "distance_m", "pose"):
        np.testing.assert_allclose(getattr(longer, name)[:n], getattr(plan, name), rtol=1e-12)
    np.testing.assert_allclose(longer.white[:, :n], plan.white, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(longer.position_m[-1], [-10.0, 5.0, 1.0])
    leg = np.linalg.norm(np.asarray(longer.position_m[-1] - plan.position_m[-1]))
    assert float(longer.distance_m[-1] - plan.distance_m[-1]) == pytest.approx(leg, rel=0.01)


def test_places_are_brought_into_the_region():
    plan = small_plan()
    asked = jnp.array([[0.0, 0.0], [31.0, 1.0], [50.0, 0.0], [25.0, 40.0]])
    path = np.asarray(plan.position_m)

    def away_m(found):
        return np.linalg.norm(path[None, :, :2] - found[:, None, :2], axis=-1).min(axis=1)

    beside = np.asarray(placed(asked, plan, region_of(3.0, lift_m=1.5)))
    assert (away_m(beside) < 3.0 + 0.2).all()
    np.testing.assert_allclose(beside[1, :2], [31.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(beside[:, 2], 1.5, atol=0.6)
    square = np.array([[20.0, -5.0], [40.0, -5.0], [40.0, 5.0], [20.0, 5.0]])
    inside = np.asarray(placed(asked, plan, region_of(3.0, areas=[square])))
    assert (away_m(inside) < 3.0 + 0.2).all()
    assert (np.abs(inside[:, :2] - np.array([30.0, 0.0])) <= np.array([10.0, 5.0]) + 1e-9).all()
    far = np.array([[0.0, -5.0], [10.0, -5.0], [5.0, 5.0]])
    found = np.asarray(placed(asked, plan, region_of(3.0, areas=[far])))
    assert ((found[:, 0] >= -1e-9) & (found[:, 0] <= 10.0 + 1e-9)).all()  # an area out of reach is still the place


@pytest.mark.parametrize(("reach_m", "areas", "message"), [(3.0, [np.eye(2)], "three points"), (0.0, [], "positive")])
def test_regions_that_cannot_be(reach_m, areas, message):
    with pytest.raises(InputError, match=message):
        region_of(reach_m, areas=areas)


def test_few_sets_stand_for_many():
    plan, one = small_plan(), one_set()
    factor = np.geomspace(0.2, 5.0, 40)
    many = NoiseEnsemble(one.sigma * jnp.asarray(factor)[:, None], jnp.full(40, 1.0 / 40), one.correlation_m)
    few = few_sets(many, plan, 4)
    found = np.asarray(few.sigma[:, 0] / one.sigma[0, 0])
    np.testing.assert_allclose(found, factor[[4, 14, 24, 34]], rtol=0.1)
    assert float(few.weight.sum()) == pytest.approx(1.0)
    assert few_sets(one, plan, 4) is one
