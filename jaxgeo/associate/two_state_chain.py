"""A hidden Markov chain with two states: the likeliest path, and the odds of each state."""

import numpy as np
from jaxtyping import Float, Int


def two_state_chain(
    state: Float[np.ndarray, "n 2"], pair: Float[np.ndarray, "m 2 2"]
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
    """Viterbi's path and the forward-backward log posteriors (up to a constant a row).

    Rabiner, "A tutorial on hidden Markov models", Proc. IEEE 77(2), 1989, sections III.A and III.B, in logarithms.

    Args:
        state: log likelihood of each state.
        pair: (n - 1, 2, 2) log likelihood of state i of a row followed by state j of the next.
    """
    n = len(state)
    best, forward, backward = state.copy(), state.copy(), np.zeros((n, 2))
    came_from = np.zeros((n, 2), dtype=np.int64)
    for k in range(1, n):
        arriving = best[k - 1][:, None] + pair[k - 1]
        came_from[k] = np.argmax(arriving, axis=0)
        best[k] += arriving.max(axis=0)
        forward[k] += np.logaddexp(*(forward[k - 1][:, None] + pair[k - 1]))
    for k in range(n - 2, -1, -1):
        backward[k] = np.logaddexp(*(pair[k] + state[k + 1] + backward[k + 1]).T)
    path = np.zeros(n, dtype=np.int64)
    path[-1] = np.argmax(best[-1])
    for k in range(n - 2, -1, -1):
        path[k] = came_from[k + 1, path[k + 1]]
    return path, forward + backward
