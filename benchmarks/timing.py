"""Wall-clock times, warm and interleaved."""

from collections.abc import Callable
from typing import Any

import numpy as np

from eval.cost import once_s, times_s

__all__ = ["medians_s", "once_s"]


def medians_s(repetitions: int, *functions: Callable[[], Any]) -> tuple[float, ...]:
    """Median seconds of each function."""
    return tuple(float(t) for t in np.median(times_s(repetitions, *functions), axis=0))
