"""Learning end to end on a small simulated session: the level is found, and what is held out is not read."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from solve.revisited_session import KIND, LOCATIONS, MEDIANS, OPTIONS, WIDTH, moved, revisited_session, tables, without

from calibration.learn import Learned, LearnOptions, learn_fold, learn_folds, prior_arrays
from calibration.models import MODELS, family_prior
from jaxgeo.graph.components import ROT, TRANS
from jaxgeo.solve.ensemble_fold import SETTLED_M, marker_m

# Of which the white noise of the session is how many times the prior's median.
SIZE = 5.0
PRIOR = prior_arrays(family_prior(KIND, MEDIANS))
BOTH = LearnOptions(OPTIONS, "both")


def learned_from(made, use=None) -> Learned:
    chain, table = tables(made)
    got = learn_fold(chain, table, PRIOR, table.real if use is None else use, WIDTH, BOTH)
    assert bool(got.fold.settled)
    return got


def level(got: Learned, group: slice) -> tuple[float, float]:
    """Mean and standard deviation of the white log sigmas over the models that have them, from the prior's median."""
    has = np.array([group.start in members for members in MODELS.values()])
    weight = np.exp(np.asarray(got.fit.log_weight)) * np.asarray(got.model_weight)[:, None]
    weight = weight[has] / weight[has].sum()
    of_draws = (np.asarray(got.fit.draws) - np.asarray(got.prior.mean)[:, None])[has][..., group].mean(axis=-1)
    mean = float((weight * of_draws).sum())
    return mean, float(np.sqrt((weight * (of_draws - mean) ** 2).sum()))


@pytest.fixture(scope="module")
def made():
    return revisited_session(6, size=SIZE)


@pytest.fixture(scope="module")
def whole(made) -> Learned:
    return learned_from(made)


def test_the_level_is_found(whole):
    """Of noise five times the prior's median most of the way is gone, in logarithms; of noise of its size, nothing."""
    for group in (TRANS, ROT):
        mean, sd = level(whole, group)
        assert 0.5 * np.log(SIZE) < mean < 1.3 * np.log(SIZE)
        assert sd < 0.6
    expected = [level(learned_from(revisited_session(seed, size=1.0)), TRANS)[0] for seed in range(4)]
    assert np.abs(np.mean(expected)) < 0.35 * np.log(SIZE)


def test_contrasts_are_rows_less_the_frame(whole, made):
    assert float(whole.found.count) == 3 * len(LOCATIONS) - 6
    assert float(learned_from(made, without(tables(made)[1], 0)).found.count) == 3 * 7 - 6 - 3
    assert float(learned_from(made, without(tables(made)[1], 1)).found.count) == 3 * 6 - 6


def test_poses_are_where_the_ensemble_predicts(whole):
    at_poses = marker_m(whole.fold.state, whole.fold.observed) + whole.fold.origin_m[None]
    assert_allclose(at_poses, whole.fold.point_m, rtol=0, atol=2.0 * SETTLED_M)
    assert_allclose(whole.fold.ensemble.weight.sum(), 1.0, rtol=1e-12)


# Everything that a fold says but how far off its prediction may be of the surveyed position, which is the survey's.
def said(got: Learned) -> list[jax.Array]:
    return jax.tree.leaves(eqx.tree_at(lambda x: x.fold.error_covariance_m2, got, None))


@pytest.mark.parametrize("location", [0, 1], ids=["visited twice", "visited once"])
def test_coordinates_held_out_reach_nothing_to_the_last_bit(made, location):
    """The held-out location 100 m elsewhere, and surveyed 30 times worse."""
    _, table = tables(made)
    use = without(table, location)
    here, there = learned_from(made, use), learned_from(moved(made, location, 100.0, 30.0), use)
    for a, b in zip(said(here), said(there), strict=True):
        assert np.array_equal(a, b)
    assert not np.array_equal(here.fold.error_covariance_m2, there.fold.error_covariance_m2)
    # The same move of a location that is used is seen by everything.
    seen = learned_from(moved(made, location, 1.0), table.real)
    assert np.abs(np.asarray(seen.fit.theta - learned_from(made).fit.theta)).max() > 1e-3


def test_sightings_held_out_tell_noise_only_where_two_tie_each_other(made):
    """Lever arms of a held-out location: of one visit nothing is learned from them, of two their difference is."""
    _, table = tables(made)

    def with_lever(location: int) -> tuple[Learned, Learned]:
        use = without(table, location)
        lever = made.anchors.lever_arm_m.copy()
        lever[np.flatnonzero(made.anchors.location_index == location)[0]] += 0.5
        other = dataclasses.replace(made, anchors=dataclasses.replace(made.anchors, lever_arm_m=lever))
        return learned_from(made, use), learned_from(other, use)

    here, there = with_lever(1)
    for a, b in zip(
        jax.tree.leaves((here.fit, here.fold.state)), jax.tree.leaves((there.fit, there.fold.state)), strict=True
    ):
        assert np.array_equal(a, b)
    here, there = with_lever(0)
    assert np.abs(np.asarray(here.fit.theta - there.fit.theta)).max() > 1e-2


def test_a_fold_among_others_is_the_fold_alone(made, whole):
    chain, table = tables(made)
    rows = jnp.stack([table.real, without(table, 0), without(table, 1)])
    found, first = learn_folds(chain, table, PRIOR, rows, WIDTH, BOTH)
    alone = [whole, learned_from(made, rows[1]), learned_from(made, rows[2])]
    for i, one in enumerate(alone):
        among = jax.tree.map(lambda x, i=i: x[i], found)
        bare = eqx.tree_at(lambda x: (x.fold.observed, x.fold.state), one, (None, None))
        for name in ("fit", "model_weight", "fold"):
            for a, b in zip(jax.tree.leaves(getattr(among, name)), jax.tree.leaves(getattr(bare, name)), strict=True):
                assert_allclose(a, b, rtol=1e-6, atol=1e-7, err_msg=name)
    for a, b in zip(jax.tree.leaves(first.state), jax.tree.leaves(whole.fold.state), strict=True):
        assert_allclose(a, b, rtol=1e-6, atol=1e-7)


def test_fewer_anchors_tell_less(made):
    """As few as fix the frame, 9 - 6 numbers, and A's difference: wider than with all, narrower than the prior."""
    use = tables(made)[1].real * (jnp.arange(8) % 2 == 1).astype(float)
    got = learned_from(made, use)
    assert float(got.found.count) == 9 - 6 + 3
    free = np.asarray(PRIOR.free)[0] > 0
    prior_sd = np.sqrt(np.linalg.inv(np.asarray(PRIOR.precision)[0][np.ix_(free, free)])[0, 0])
    few, many = (float(np.sqrt(np.asarray(each.fit.covariance)[0, 0, 0])) for each in (got, learned_from(made)))
    assert many < few < prior_sd
