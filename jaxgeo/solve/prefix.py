"""Prefix sums along the chain, by blocks: no scan over single poses, and nothing of size poses x anchors."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

# A block of the chain; divides every pose bucket.
BLOCK = 32
# Poses above which a chain's rows no longer fit the processor's cache.
LONG = 1 << 16


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


def prefix_sums_of(
    rows_of: Callable[[PyTree], list[Array]], per_pose: PyTree[Float[Array, "n"]], index: Int[Array, "k"]
) -> Float[Array, "m k"]:
    """`prefix_sum_at` of the rows that a function makes of per-pose vectors, element by element.

    On a long chain the rows are never kept (27 of them cost as much to write as to make): blocks are summed as they are
    made, and made again for the blocks of the poses asked for.
    """
    n = jax.tree.leaves(per_pose)[0].shape[0]
    if n <= LONG:
        return prefix_sum_at(jnp.stack(rows_of(per_pose)), index)
    total = jnp.stack([row.reshape(-1, BLOCK).sum(axis=-1) for row in rows_of(per_pose)])
    before = prefix_sum(total) - total
    block, place = index // BLOCK, index % BLOCK
    near = (block[:, None] * BLOCK + jnp.arange(BLOCK)[None, :]).reshape(-1)
    again = jnp.stack(rows_of(jax.tree.map(lambda v: v[near], per_pose))).reshape(-1, index.shape[0], BLOCK)
    part = jnp.where((jnp.arange(BLOCK)[None, :] <= place[:, None])[None], again, 0.0)
    return before[:, block] + part.sum(axis=-1)
