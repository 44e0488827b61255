import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxgeo.solve.gauge import determined, free_direction_words, gauge_covariance

NONE = jnp.zeros((4, 3, 3))


def information(sigma_m: float) -> jnp.ndarray:
    return jnp.broadcast_to(jnp.eye(3) / sigma_m, (4, 3, 3))


def cross_of(a_m: float, b_m: float) -> jnp.ndarray:
    """Two points a to either side along E, two b along N."""
    return jnp.asarray([[a_m, 0.0, 7.0], [-a_m, 0.0, 7.0], [0.0, b_m, 7.0], [0.0, -b_m, 7.0]])


def test_standard_deviations_of_a_cross():
    """Turn about E: two arms of b; about N: two of a; about h: all four. Shifts: the mean of four."""
    sigma, _ = gauge_covariance(cross_of(30.0, 5.0), information(0.02), NONE)
    expected = [
        0.02 / (5.0 * np.sqrt(2)),
        0.02 / (30.0 * np.sqrt(2)),
        0.02 / np.sqrt(2 * (30.0**2 + 5.0**2)),
        *[0.02 / 2.0] * 3,
    ]
    assert_allclose(np.sort(sigma), np.sort(expected), rtol=1e-9)


@pytest.mark.parametrize("b_m", [0.0, 0.03])
def test_weakest_turn_is_named(b_m):
    """3 cm to either side, known to 2 cm: 27 degrees."""
    sigma, vector = gauge_covariance(cross_of(30.0, b_m), information(0.02), NONE)
    assert not bool(determined(sigma, vector))
    words = free_direction_words(np.asarray(sigma), np.asarray(vector))
    assert words.startswith("the turn about the direction (E 1.00, N ")
    assert ("wholly" if b_m == 0.0 else "known to 27 degrees only") in words


def test_a_surveyed_rotation_fixes_the_turn_about_a_line():
    rotation = jnp.zeros((4, 3, 3)).at[1].set(jnp.eye(3) / 0.01**2)
    sigma, vector = gauge_covariance(cross_of(30.0, 0.0), information(0.02), rotation)
    assert bool(determined(sigma, vector))
    turning = np.sum(np.asarray(vector)[3:] ** 2, axis=0) > 0.5
    assert_allclose(np.asarray(sigma)[turning].max(), 0.01, rtol=1e-9)


def test_no_anchor_at_all():
    sigma, vector = gauge_covariance(cross_of(30.0, 5.0), jnp.zeros((4, 3, 3)), NONE)
    assert not bool(determined(sigma, vector))


def test_held_out_anchors_count_for_nothing():
    used = information(0.02).at[2:].set(0.0)
    sigma, vector = gauge_covariance(cross_of(30.0, 5.0), used, NONE)
    assert not bool(determined(sigma, vector))
