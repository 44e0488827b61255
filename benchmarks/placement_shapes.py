"""Where the gradient search sits: on three shapes of path, beside every choice of a fine grid and simpler ways."""

import math
import time
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from eval.placement.candidates import candidates_along, equal_spacing
from eval.placement.gradient_search import SearchSettings, gradient_search
from eval.placement.known_visits import candidate_visits
from eval.placement.planned import PlacementInput, task_of
from eval.placement.predicted import UNDETERMINED_M
from eval.placement.problem import Problem, accuracy, accuracy_m
from eval.placement.subset_search import best_subset, exchanged, greedy_subset
from jaxgeo.data import Trajectory
from jaxgeo.graph.components import ensemble_of
from jaxgeo.graph.noise_defaults import default_noise

Shape = Literal["loop", "corridor", "figure of eight"]
SHAPES: tuple[Shape, ...] = ("loop", "corridor", "figure of eight")
COUNTS = (3, 4, 5, 6)
POSES = 600
# What is possible, the same for every shape: metres.
GIVEN = PlacementInput(
    counts=COUNTS, range_m=6.0, sighting_sigma_m=0.05, survey_sigma_m=(0.02, 0.02, 0.02), apart_m=12.0, reach_m=4.0
)
# Grids (along, aside) of which every choice is tried, by count: on the path itself, and to both sides of it.
GRIDS: dict[int, tuple[tuple[int, int], ...]] = {
    3: ((96, 1), (40, 3)),
    4: ((48, 1), (16, 3)),
    5: ((32, 1), (10, 3)),
    6: ((25, 1), (8, 3)),
}
# Far too fine for every choice: improved by exchange, from the greedy one.
EXCHANGED = (48, 3)
STEP_M = 1e-4


def shape_path(shape: Shape, poses: int = POSES) -> Trajectory:
    """A path of some 120 to 240 m, driven nose first at constant steps of its parameter, 10 poses a second."""
    s = np.linspace(0.0, 2.0 * np.pi, poses)
    if shape == "loop":
        position = np.column_stack([30.0 * np.cos(s), 20.0 * np.sin(s), 0.5 * np.sin(2.0 * s)])
    elif shape == "corridor":
        position = np.column_stack([120.0 / (2.0 * np.pi) * s, 2.0 * np.sin(3.0 * s), 0.0 * s])
    else:
        position = np.column_stack([40.0 * np.sin(s), 25.0 * np.sin(2.0 * s), 0.0 * s])
    ahead = np.gradient(position, axis=0)
    turn = np.column_stack([0.0 * s, 0.0 * s, np.arctan2(ahead[:, 1], ahead[:, 0])])
    return Trajectory(0.1 * np.arange(poses), position, Rotation.from_rotvec(turn).as_quat(scalar_first=True))


def shape_problem(shape: Shape, poses: int = POSES) -> Problem:
    """What `place_anchors` searches under, for a shape and the documented noise of LiDAR odometry."""
    return task_of(shape_path(shape, poses), ensemble_of(default_noise("lidar")), GIVEN).search


def shapes(starts: int, seed: int) -> dict[str, Any]:
    """Every shape and count, and the largest relative difference of a gradient from central differences."""
    rows, difference = [], 0.0
    for shape in SHAPES:
        problem = shape_problem(shape)
        difference = max(difference, gradient_difference(problem, seed))
        rows += [{"shape": shape} | case(count, problem, starts, seed) for count in COUNTS]
    return {
        "gap_to_exhaustive": max(row["gap_to_exhaustive"] for row in rows),
        "gap_to_best_known": max(row["gap_to_best_known"] for row in rows),
        "gradient_difference": difference,
        "rows": rows,
    }


def case(count: int, problem: Problem, starts: int, seed: int) -> dict[str, Any]:
    """All ways to place `count` markers; accuracies in metres, infinite where the frame is not fixed."""
    started = time.perf_counter()
    found = gradient_search(count, problem, SearchSettings(starts=starts, seed=seed))
    seconds = time.perf_counter() - started
    exhaustive = {
        f"{along} x {aside}": best_subset(candidate_visits(candidates_along(problem, along, aside), problem), count)[1]
        for along, aside in GRIDS[count]
    }
    fine = candidate_visits(candidates_along(problem, *EXCHANGED), problem)
    greedy, greedy_m = greedy_subset(fine, count)
    exchange_m = exchanged(fine, greedy)[1]
    even = float(accuracy(jnp.asarray(equal_spacing(count, problem)), problem))
    gradient_m, best_m = float(found.value_m[0]), min(exhaustive.values())
    return {
        "anchors": count,
        "gradient_m": gradient_m,
        "exhaustive_m": exhaustive,
        "choices_tried": sum(math.comb(along * aside, count) for along, aside in GRIDS[count]),
        "greedy_m": greedy_m,
        "exchange_m": exchange_m,
        "equal_spacing_m": even if even < UNDETERMINED_M else None,
        "gap_to_exhaustive": gradient_m / best_m - 1.0,
        "gap_to_best_known": gradient_m / min(best_m, exchange_m) - 1.0,
        "starts_near_best": int(np.sum(found.value_m <= 1.01 * gradient_m)),
        "gradient_seconds": seconds,
    }


def gradient_difference(problem: Problem, seed: int) -> float:
    """Of the criterion in every coordinate of random layouts beside the path, in units of the largest component."""
    random = np.random.default_rng(seed)
    candidates = candidates_along(problem, 48)
    worst = 0.0
    for count in COUNTS:
        point = candidates[random.choice(len(candidates), count, replace=False)]
        point = point + random.uniform(-1.0, 1.0, point.shape)
        exact = np.asarray(_gradient(jnp.asarray(point), problem))
        about = differences(point, problem)
        worst = max(worst, float(np.abs(exact - about).max() / np.abs(exact).max()))
    return worst


_gradient = jax.jit(jax.grad(accuracy_m))


def differences(point_m: Float[np.ndarray, "k 3"], problem: Problem) -> Float[np.ndarray, "k 3"]:
    """Central differences of the criterion."""
    found = np.zeros_like(point_m)
    for i in np.ndindex(*point_m.shape):
        step = np.zeros_like(point_m)
        step[i] = STEP_M
        ahead, behind = (float(accuracy(jnp.asarray(point_m + sign * step), problem)) for sign in (1.0, -1.0))
        found[i] = (ahead - behind) / (2.0 * STEP_M)
    return found
