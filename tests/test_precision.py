"""Compiled programs are let go where they take too many memory maps, and only there."""

import jax
import jax.numpy as jnp
import pytest

from jaxgeo.precision import let_programs_go


@pytest.fixture
def double():
    found = jax.jit(lambda x: x + x)
    assert float(found(jnp.ones(()))) == 2.0
    return found


def test_many_programs_are_let_go_and_compiled_again(double):
    assert double._cache_size() == 1
    assert let_programs_go(most_maps=1)
    assert double._cache_size() == 0
    assert float(double(jnp.ones(()))) == 2.0


def test_few_programs_stay(double):
    assert not let_programs_go(most_maps=10**9)
    assert double._cache_size() == 1
