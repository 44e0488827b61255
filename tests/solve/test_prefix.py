import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxgeo.graph.bucket import pose_bucket
from jaxgeo.solve.prefix import prefix_sum, prefix_sum_at, suffix_sum

prefix, suffix, at = jax.jit(prefix_sum), jax.jit(suffix_sum), jax.jit(prefix_sum_at)


@pytest.mark.parametrize("n", [7, 32, 100, 128, 160, pose_bucket(40_000)])
def test_sums_are_those_of_numpy(n):
    x = np.random.default_rng(n).standard_normal((3, n))
    assert_allclose(prefix(x), np.cumsum(x, axis=1), rtol=0, atol=1e-11)
    assert_allclose(suffix(x), np.cumsum(x[:, ::-1], axis=1)[:, ::-1], rtol=0, atol=1e-11)


@pytest.mark.parametrize("n", [128, 160, pose_bucket(40_000)])
def test_sums_at_some_poses(n):
    rng = np.random.default_rng(n)
    x = rng.standard_normal((3, n))
    index = np.array([0, 1, 30, 31, 32, 33, 63, 64, n - 33, n - 32, n - 1, *rng.integers(0, n, 5)])
    assert_allclose(at(x, index), np.cumsum(x, axis=1)[:, index], rtol=0, atol=1e-11)
