"""Prefix sums along the chain, by blocks: no scan over single poses, and nothing of size poses x anchors."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

# A block of the chain; divides every pose bucket.
BLOCK = 32


def prefix_sum(x: Float[Array, "m n"]) -> Float[Array, "m n"]:
    """Inclusive prefix sums of every row: sums inside a block are a product with a triangle of ones."""
    m, n = x.shape
    if n <= BLOCK or n % BLOCK:
        return jnp.cumsum(x, axis=1)
    inside = x.reshape(m, n // BLOCK, BLOCK) @ jnp.triu(jnp.ones((BLOCK, BLOCK)))
    total = inside[..., -1]
    before = prefix_sum(total) - total
    return (inside + before[..., None]).reshape(m, n)


def suffix_sum(x: Float[Array, "m n"]) -> Float[Array, "m n"]:
    """Inclusive suffix sums of every row."""
    return prefix_sum(x[:, ::-1])[:, ::-1]


def prefix_sum_at(x: Float[Array, "m n"], index: Int[Array, "k"]) -> Float[Array, "m k"]:
    """Inclusive prefix sums of every row, only up to the poses asked for: whole blocks, then the rest of one block."""
    m, n = x.shape
    blocks = x.reshape(m, n // BLOCK, BLOCK)
    total = blocks.sum(axis=-1)
    before = prefix_sum(total) - total
    block, place = index // BLOCK, index % BLOCK
    part = jnp.where(jnp.arange(BLOCK)[None, :] <= place[:, None], blocks[:, block], 0.0)
    return before[:, block] + part.sum(axis=-1)
