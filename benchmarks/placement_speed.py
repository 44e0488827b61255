"""How long the gradient search takes on a long path: 10 000 poses, ten markers, 64 starts."""

import dataclasses
import os
import time
from typing import Any

import numpy as np

from benchmarks.placement_shapes import shape_problem
from benchmarks.timing import once_s
from eval.placement.gradient_search import SearchSettings, gradient_search
from eval.placement.predicted import watched
from eval.placement.problem import Problem

POSES, COUNT = 10_000, 10
# Points of the path under which layouts are searched: what `place_anchors` takes, and twice as many.
WATCHED = (64, 128)
REPETITIONS = 3


def speed(starts: int, seed: int) -> list[dict[str, Any]]:
    """First call, and the median of the next ones, on the problem that `place_anchors` makes of the path.

    `warm_processor_s` adds up all cores: what the search takes on a machine that others use too.
    """
    search = shape_problem("figure of eight", POSES)
    settings = SearchSettings(starts=starts, seed=seed)
    rows = []
    for points in WATCHED:
        problem = dataclasses.replace(
            search, watch=watched(search.plan, search.noise, points, beside_m=search.beside_m)
        )
        reached_m: list[float] = []
        busy_s: list[float] = []

        def search_again(
            problem: Problem = problem, reached_m: list[float] = reached_m, busy_s: list[float] = busy_s
        ) -> None:
            started = time.process_time()
            reached_m.append(float(gradient_search(COUNT, problem, settings).value_m[0]))
            busy_s.append(time.process_time() - started)

        first_s, *warm_s = (once_s(search_again) for _ in range(1 + REPETITIONS))
        rows.append(
            {
                "poses": POSES,
                "knots": len(search.plan),
                "anchors": COUNT,
                "starts": starts,
                "watched": points,
                "first_call_s": first_s,
                "warm_s": float(np.median(warm_s)),
                "warm_processor_s": float(np.median(busy_s[1:])),
                "accuracy_m": reached_m[-1],
                "load_average": os.getloadavg()[0],
                "cores": len(os.sched_getaffinity(0)),
            }
        )
    return rows
