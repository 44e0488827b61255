"""A process of its own that times its first solve, tracing and compiling included: `python -m benchmarks.first_call N`.

Compiled programs are kept in `$JAXGEO_CACHE`: run it twice on one folder to see what the cache saves.
"""

import json
import sys

import jax

from benchmarks.chain import chain_graph
from benchmarks.timing import once_s
from jaxgeo.precision import enable_compilation_cache
from jaxgeo.solve.solver import solve_graph


def first_call_s(n: int) -> float:
    """Seconds of the first solve of n poses and 7 anchors; the graph is made beforehand."""
    enable_compilation_cache()
    graph = jax.block_until_ready(chain_graph(n, 7))
    return once_s(lambda: jax.jit(solve_graph)(graph))


if __name__ == "__main__":
    print(json.dumps(first_call_s(int(sys.argv[1]))))
