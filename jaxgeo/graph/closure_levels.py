"""Ever coarser copies of a graph: neighbours are put together, two by two and twice over, until few are left.

A group of poses that moves as one rigid body has one world-frame increment, so that a coarser graph of groups is again
a graph of poses, the weights of its edges sums of the finer ones. This is aggregation multigrid (Notay, An
aggregation-based algebraic multigrid method, ETNA 2010), whose piecewise constant vectors are, in these coordinates,
exactly the motions that cost little.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxgeo.graph.bucket import anchor_bucket

# Groups of the last, directly solved level. Its Cholesky factor (6 x 64 rows) takes about as long as two products with
# a graph of 5000 poses; with 100 groups the factor took most of a step.
MOST_AT_LAST = 64
# Nodes tied less strongly than this share of the strongest tie do not go together: false closures, most likely.
_WEAKEST = 1e-3


class Level(eqx.Module):
    """One graph of the hierarchy and how it is made coarser.

    Attributes:
        first, second: (m,) nodes that its edges tie; padding ties node 0 to itself.
        group: (n,) the node of the next level that a node belongs to; padding belongs to none (an index past the end).
        coarse_edge: (m,) the next level's edge that an edge goes into; past the end where it lies inside one group.
        counts: nodes and edges of the next level, padded.
    """

    first: Int[Array, "m"]
    second: Int[Array, "m"]
    group: Int[Array, "n"]
    coarse_edge: Int[Array, "m"]
    counts: tuple[int, int] = eqx.field(static=True)


class Coarsest(eqx.Module):
    """The last graph: `real` is 1 for its nodes and 0 for padding."""

    first: Int[Array, "m"]
    second: Int[Array, "m"]
    real: Float[Array, "n"]


def coarser_levels(
    n: int, first: Int[np.ndarray, "m"], second: Int[np.ndarray, "m"], strength: Float[np.ndarray, "m"]
) -> tuple[tuple[Level, ...], Coarsest]:
    """The hierarchy of a graph of n nodes; its edges come padded with ties of node 0 to itself."""
    levels = []
    while n > MOST_AT_LAST:
        group, pairs = _paired(n, first, second, strength)
        again, k = _paired(pairs, *_contracted(group, first, second, strength)[:3])
        if k > 0.8 * n:  # hardly any two are tied: nothing to be gained by going on
            break
        group = again[group]
        low, high, total, edge = _contracted(group, first, second, strength)
        counts = (node_bucket(k), len(low))
        levels.append(
            Level(
                _device(first), _device(second), _device(grown(group, node_bucket(n), counts[0])), _device(edge), counts
            )
        )
        n, first, second, strength = k, low, high, total
    real = jnp.asarray(np.arange(node_bucket(n)) < n, dtype=float)
    return tuple(levels), Coarsest(_device(first), _device(second), real)


def node_bucket(n: int) -> int:
    """Padded number of nodes."""
    return anchor_bucket(n)


def edge_bucket(m: int) -> int:
    """Padded number of edges."""
    return anchor_bucket(m)


def grown(values: np.ndarray, length: int, fill: float = 0) -> np.ndarray:
    """Padded with `fill` to a length."""
    return np.pad(values, (0, length - len(values)), constant_values=fill)


def _device(index: Int[np.ndarray, "m"]) -> Int[Array, "m"]:
    return jnp.asarray(index.astype(np.int32))


def _paired(
    n: int, first: Int[np.ndarray, "m"], second: Int[np.ndarray, "m"], strength: Float[np.ndarray, "m"]
) -> tuple[Int[np.ndarray, "n"], int]:
    """Groups of two neighbours (now and then three): an edge makes a pair where it is the strongest at both its ends.

    Ties are broken by fixed pseudo-random numbers, so that the rounds needed grow as the logarithm of n only.
    """
    strength = strength * (1.0 + 0.1 * np.random.default_rng(0).random(len(first)))
    mate = np.full(n, -1)
    usable = np.flatnonzero((first != second) & (strength > _WEAKEST * strength.max(initial=0.0)))
    live = usable
    while live.size:
        best = np.zeros(n)
        np.maximum.at(best, first[live], strength[live])
        np.maximum.at(best, second[live], strength[live])
        chosen = live[(strength[live] == best[first[live]]) & (strength[live] == best[second[live]])]
        mate[first[chosen]], mate[second[chosen]] = second[chosen], first[chosen]
        live = live[(mate[first[live]] < 0) & (mate[second[live]] < 0)]
    leader = np.where((mate >= 0) & (mate < np.arange(n)), mate, np.arange(n))
    # Whoever is left over has only paired neighbours, and joins the strongest of them.
    for here, there in ((first, second), (second, first)):
        joins = usable[(mate[here[usable]] < 0) & (mate[there[usable]] >= 0)]
        joins = joins[np.argsort(strength[joins], kind="stable")]
        leader[here[joins]] = leader[there[joins]]
    found, group = np.unique(leader, return_inverse=True)
    return group, len(found)


def _contracted(
    group: Int[np.ndarray, "n"], first: np.ndarray, second: np.ndarray, strength: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Edges between groups, padded: ends, strengths summed; and the one that every old edge goes into."""
    a, b = group[first], group[second]
    low, high = np.minimum(a, b), np.maximum(a, b)
    between = low < high
    n = int(group.max(initial=0)) + 1
    pairs, index = np.unique(low[between] * n + high[between], return_inverse=True)
    m = edge_bucket(len(pairs))
    edge = np.full(len(first), m)
    edge[between] = index
    return grown(pairs // n, m), grown(pairs % n, m), np.bincount(index, strength[between], m), edge
