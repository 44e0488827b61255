"""Bootstrap intervals against a plain loop over the same resampled rows, and what intervals have to do."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from eval.bootstrap import bootstrap_interval, geometric_mean, mean, ratio_of_means, resampled_rows, rms
from jaxgeo.errors import InputError

PAIRS = np.random.default_rng(4).lognormal(0.0, 0.6, (13, 2))
LOOPS = {
    mean: lambda v: sum(float(x) for x in v.ravel()) / v.size,
    rms: lambda v: np.sqrt(sum(float(x) ** 2 for x in v.ravel()) / v.size),
    geometric_mean: lambda v: float(np.prod(v) ** (1.0 / v.size)),
    ratio_of_means: lambda v: float(v[:, 0].sum() / v[:, 1].sum()),
}


@pytest.mark.parametrize("statistic", LOOPS, ids=lambda s: s.__name__)
def test_as_a_plain_loop(statistic):
    rows = resampled_rows(13, seed=7, draws=500)
    found = np.sort([LOOPS[statistic](PAIRS[row]) for row in rows])
    expected = np.interp([0.05, 0.95], np.arange(500) / 499, found)
    assert_allclose(bootstrap_interval(PAIRS, statistic, seed=7, draws=500, level=0.9), expected, rtol=1e-10)


def test_rows_are_drawn_with_repetition_and_all_alike():
    rows = resampled_rows(13, seed=0)
    assert rows.shape == (2000, 13)
    share = np.bincount(rows.ravel(), minlength=13) / rows.size
    assert_allclose(share, 1 / 13, atol=4 * np.sqrt(1 / 13 / rows.size))
    assert (np.array([len(set(row)) for row in rows]) < 13).mean() > 0.99


def test_a_seed_gives_one_interval_and_another_seed_another():
    first, again, other = (bootstrap_interval(PAIRS, ratio_of_means, seed=s) for s in (3, 3, 4))
    assert first == again
    assert first != other
    assert_allclose(first, other, rtol=0.05)


def test_of_a_normal_mean_it_is_the_textbook_interval():
    values = np.random.default_rng(5).normal(2.0, 1.0, 400)
    low, high = bootstrap_interval(values, mean, seed=1)
    half = 1.96 * values.std() / 20.0
    assert_allclose([low, high], [values.mean() - half, values.mean() + half], atol=0.02)


def test_what_cannot_be_resampled():
    assert np.isnan(bootstrap_interval(np.ones((1, 2)), ratio_of_means, seed=0)).all()
    for bad in (np.zeros(0), np.array([1.0, np.nan])):
        with pytest.raises(InputError, match="bootstrap of an array of shape"):
            bootstrap_interval(bad, mean, seed=0)
