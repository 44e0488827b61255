"""A process of its own that solves one long chain: seconds and peak memory.

`python -m benchmarks.million N K NOISE`, NOISE one of `lidar`, `paper`.
"""

import json
import resource
import sys

import jax

from benchmarks.chain import LIDAR, WHITE, chain_graph
from benchmarks.timing import medians_s, once_s
from jaxgeo.solve.solver import result_words, solve_graph

REPETITIONS = 5
NOISES = {"lidar": LIDAR, "paper": WHITE}


def long_chain(n: int, k: int, noise: str) -> dict[str, float | int | str]:
    """Solve n poses with k anchors: first call (compile included), warm median, peak memory of the whole process."""
    graph = jax.block_until_ready(chain_graph(n, k, noise=NOISES[noise]))
    made_gib = peak_gib()
    solve = jax.jit(solve_graph)
    first_s = once_s(lambda: solve(graph))
    (warm_s,) = medians_s(REPETITIONS, lambda: solve(graph))
    found = solve(graph)
    return {
        "first_call_s": first_s,
        "warm_s": warm_s,
        "peak_gib": peak_gib(),
        "peak_before_solving_gib": made_gib,
        "steps": int(found.steps),
        "result": result_words(found.result),
    }


def peak_gib() -> float:
    """Peak resident memory of this process; Linux counts in KiB, macOS in bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30


if __name__ == "__main__":
    print(json.dumps(long_chain(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])))
