"""Wall-clock times, warm and interleaved."""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np


def once_s(function: Callable[[], Any]) -> float:
    """Seconds of one call, its arrays ready."""
    start = time.perf_counter()
    jax.block_until_ready(function())
    return time.perf_counter() - start


def medians_s(repetitions: int, *functions: Callable[[], Any]) -> tuple[float, ...]:
    """Median seconds of each function: one call each to warm up, then all in turn, again and again.

    On a shared machine both sides then see the same neighbours.
    """
    for function in functions:
        once_s(function)
    times = np.array([[once_s(function) for function in functions] for _ in range(repetitions)])
    return tuple(float(t) for t in np.median(times, axis=0))
