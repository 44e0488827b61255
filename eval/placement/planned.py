"""From a path, its noise and what is possible to an answer: layouts compared, and what would change the chosen one."""

import dataclasses
import math
import time
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from eval.placement.answer import Method, PlacementAnswer, PlannedLayout, PlannedVisit
from eval.placement.candidates import candidates_along, equal_spacing, most_passes
from eval.placement.criteria import CRITERIA, Criterion, Robust, robust_criterion_m
from eval.placement.gradient_search import Found, SearchSettings, gradient_search
from eval.placement.known_visits import KnownVisits, candidate_visits
from eval.placement.noise_sets import few_sets
from eval.placement.plan import plan_of, position_at, wandering
from eval.placement.plan_visits import MOST_PASSES, Sight, distance_of, plan_visits
from eval.placement.predicted import UNDETERMINED_M, watched
from eval.placement.problem import Problem, accuracy, predicted_covariance, without_standing
from eval.placement.region import region_of
from eval.placement.subset_search import Choice, best_subset, exchanged, greedy_subset
from eval.placement.what_if import sensitivity, what_if
from jaxgeo.data import Trajectory
from jaxgeo.errors import InputError
from jaxgeo.graph.components import NoiseEnsemble

# Places along the path: at most so many, fewer where all choices of them are tried.
_ALONG, _LEAST_ALONG = 48, 12
# Noise sets and points of the path that layouts are searched under; the answer is worked out under all of them. The
# search watches points beside the path: markers on one line would leave the turn about it open, and what was mapped
# beside the path with it.
SEARCH_SETS, SEARCH_WATCHED, SEARCH_BESIDE_M = 4, 64, 1.0


@dataclasses.dataclass(frozen=True)
class PlacementInput:
    """What is wanted and what is possible; local frame, metres.

    Attributes:
        counts: of markers to be placed, one answer each; `standing_m` (f, 3) stand already, on top of these.
        criterion, robust: see `eval.placement.criteria`.
        reach_m: markers stand at most so far from the path in plan; `lift_m` above it.
        areas_en_m: outlines (n, 2); a marker stands in one of them; none: anywhere.
        candidate_m: (c, 3) the only places where markers may stand; None: anywhere allowed.
        range_m, sighting_sigma_m, survey_sigma_m, apart_m: see `Sight`; `sighting_floor_m`: of the sighting's, what no
            dwell averages out.
        most_passes: of a marker that count: 1 where one marker is moved along.
        starts, seed: of the gradient search; `watched` points of the path.
        exhaustive: all choices of candidates are tried where they are no more than this.
    """

    counts: tuple[int, ...]
    range_m: float
    sighting_sigma_m: float
    survey_sigma_m: tuple[float, float, float]
    apart_m: float
    reach_m: float
    lift_m: float = 0.0
    sighting_floor_m: float = 0.0
    areas_en_m: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    candidate_m: Float[np.ndarray, "c 3"] | None = None
    candidate_name: tuple[str, ...] = ()
    standing_m: Float[np.ndarray, "f 3"] = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    standing_name: tuple[str, ...] = ()
    criterion: Criterion = "path"
    robust: Robust = "mixture"
    most_passes: int = MOST_PASSES
    starts: int = 64
    seed: int = 0
    watched: int = 128
    exhaustive: int = 50_000


@dataclasses.dataclass(frozen=True)
class Task:
    """`problem` under all noise sets, and `search` under a few."""

    path: Trajectory
    given: PlacementInput
    problem: Problem
    search: Problem


def place_anchors(
    path: Trajectory, noise: NoiseEnsemble, given: PlacementInput, say: Callable[[str], None] = lambda _: None
) -> tuple[PlacementAnswer, ...]:
    """The best layout found of every number of markers, beside equal spacing and other ways to choose.

    Args:
        path: planned, or of an earlier session.
        noise: learned from an earlier session, or `ensemble_of` a documented default.
        say: is told what is done next.

    Raises:
        TrajectoryError: a path that does not move.
        InputError: too few markers to fix the frame, or more than there are candidates.
    """
    task = task_of(path, noise, given)
    return tuple(_placed(count, task, say) for count in given.counts)


def predict_layout(
    path: Trajectory,
    noise: NoiseEnsemble,
    given: PlacementInput,
    point_m: Float[np.ndarray, "k 3"],
    name: tuple[str, ...],
) -> PlacementAnswer:
    """What a given layout promises; `given.standing_m` is not added to it.

    Raises:
        TrajectoryError: a path that does not move.
        InputError: fewer than three markers.
    """
    if len(point_m) < 3:
        raise InputError(f"a layout of {len(point_m)} markers cannot fix the frame; expected three or more.")
    task = task_of(path, noise, dataclasses.replace(given, standing_m=np.zeros((0, 3)), standing_name=()))
    layout = _layout("given", point_m, list(name), (False,) * len(name), task, 0.0)
    return _answer((layout,), task, None)


def task_of(path: Trajectory, noise: NoiseEnsemble, given: PlacementInput) -> Task:
    """Everything that layouts are judged by.

    Raises:
        TrajectoryError: a path that does not move.
    """
    plan = plan_of(path, wanders=wandering(noise))
    sight = Sight(
        jnp.asarray(given.range_m),
        jnp.asarray(given.sighting_sigma_m),
        jnp.asarray(given.survey_sigma_m),
        jnp.asarray(given.apart_m),
    )
    region = region_of(given.reach_m, given.lift_m, given.areas_en_m)

    def under(some: NoiseEnsemble, count: int, beside_m: float, passes: int) -> Problem:
        return Problem(
            plan,
            some,
            watched(plan, some, count, beside_m=beside_m),
            sight,
            region,
            jnp.asarray(given.standing_m),
            jnp.asarray(beside_m),
            passes,
            given.criterion,
            given.robust,
        )

    few = few_sets(noise, plan, SEARCH_SETS)
    points = min(given.watched, SEARCH_WATCHED)
    passes = most_passes(under(few, points, SEARCH_BESIDE_M, given.most_passes))
    whole, search = under(noise, given.watched, 0.0, passes), under(few, points, SEARCH_BESIDE_M, passes)
    return Task(path, given, whole, search)


def _placed(count: int, task: Task, say: Callable[[str], None]) -> PlacementAnswer:
    given, search = task.given, task.search
    if given.candidate_m is not None and count > len(given.candidate_m):
        raise InputError(f"{count} markers, but {len(given.candidate_m)} candidates: expected no more than these.")
    if count + len(given.standing_m) < 3:
        raise InputError(
            f"{count} markers cannot fix the frame; expected three or more, with those that stand already."
        )
    layouts, found = [], None

    def add(method: Method, start: float, point_m: Float[np.ndarray, "k 3"]) -> None:
        layouts.append(_of_method(method, point_m, task, time.perf_counter() - start))

    if given.candidate_m is None:
        start = time.perf_counter()
        say(f"{count} markers: gradient search")
        found = gradient_search(count, search, SearchSettings(starts=given.starts, seed=given.seed))
        add("gradient", start, found.point_m[0])
    for method, candidate, choose in _choices(count, task):
        start = time.perf_counter()
        say(f"{count} markers: {method}")
        rows, _ = choose(candidate_visits(candidate, search), count)
        add(method, start, candidate[rows])
    add("equal spacing", time.perf_counter(), _equally_spaced(count, task))
    layouts.sort(key=lambda layout: layout.accuracy_m[given.criterion])
    say(f"{count} markers: what if")
    return _answer(tuple(layouts), task, found)


def _choices(count: int, task: Task) -> list:
    """(method, candidates, how) of the searches over candidates."""
    given = task.given

    def by_exchange(known: KnownVisits, count: int) -> Choice:
        return exchanged(known, greedy_subset(known, count)[0])

    if given.candidate_m is not None:
        candidate = given.candidate_m
        all_tried = math.comb(len(candidate), count) <= given.exhaustive
        best = ("exhaustive", candidate, best_subset) if all_tried else ("exchange", candidate, by_exchange)
        return [best, ("greedy", candidate, greedy_subset)]
    along = next((n for n in range(_ALONG, 0, -1) if math.comb(n, count) <= given.exhaustive), 0)
    choices: list = [("greedy", candidates_along(task.search, max(_ALONG, 2 * count)), greedy_subset)]
    if along >= max(_LEAST_ALONG, count):
        choices.append(("exhaustive", candidates_along(task.search, along), best_subset))
    return choices


def _equally_spaced(count: int, task: Task) -> Float[np.ndarray, "k 3"]:
    """Equal spacing; with candidates, the nearest of them that is not taken yet."""
    even = equal_spacing(count, task.search)
    candidate = task.given.candidate_m
    if candidate is None:
        return even
    taken: list[int] = []
    for point in even:
        away = np.linalg.norm(candidate - point, axis=1)
        away[taken] = np.inf
        taken.append(int(np.argmin(away)))
    return candidate[taken]


def _of_method(method: Method, point_m: Float[np.ndarray, "k 3"], task: Task, seconds: float) -> PlannedLayout:
    """A layout of new markers, named in the order of the path, and the standing ones."""
    given = task.given
    place = np.asarray(plan_visits(jnp.asarray(point_m), task.problem.plan, task.problem.sight, 1).place)
    point_m = point_m[np.argsort(place, kind="stable")]
    if given.candidate_m is None:
        name = [f"P{i + 1}" for i in range(len(point_m))]
    else:
        row = [int(np.argmin(np.linalg.norm(given.candidate_m - point, axis=1))) for point in point_m]
        name = [given.candidate_name[i] for i in row] if given.candidate_name else [f"candidate {i + 1}" for i in row]
    standing = (False,) * len(name) + (True,) * len(given.standing_m)
    return _layout(
        method, np.concatenate([point_m, given.standing_m]), [*name, *given.standing_name], standing, task, seconds
    )


def _layout(
    method: Method,
    point_m: Float[np.ndarray, "k 3"],
    name: list[str],
    standing: tuple[bool, ...],
    task: Task,
    seconds: float,
) -> PlannedLayout:
    problem = without_standing(task.problem)
    covariance = _predicted(jnp.asarray(point_m), problem)
    weight = problem.noise.weight
    predicted: dict[Criterion, float] = {}
    for kind in CRITERIA:
        predicted[kind] = float(robust_criterion_m(covariance, weight, kind, problem.robust))
    beside = float(accuracy(jnp.asarray(point_m), without_standing(task.search)))
    if not max(beside, *predicted.values()) < UNDETERMINED_M:
        predicted = dict.fromkeys(CRITERIA, math.inf)
    visits = plan_visits(jnp.asarray(point_m), problem.plan, problem.sight, problem.passes)
    distance = np.asarray(distance_of(visits, problem.plan))
    seen, location = np.asarray(visits.seen), np.asarray(visits.location)
    order = [i for i in np.argsort(distance, kind="stable") if seen[i] > 0.0]
    return PlannedLayout(
        method=method,
        name=tuple(name),
        standing=standing,
        point_m=point_m,
        accuracy_m=predicted,
        covariance_m2=np.asarray(jnp.einsum("q,qmab->mab", weight, covariance)),
        visits=tuple(PlannedVisit(name[location[i]], float(distance[i]), float(seen[i])) for i in order),
        seconds=seconds,
    )


_predicted = eqx.filter_jit(predicted_covariance)


def _answer(layouts: tuple[PlannedLayout, ...], task: Task, found: Found | None) -> PlacementAnswer:
    chosen, problem = layouts[0], task.problem
    points = problem.watch.points
    near = 0 if found is None else int(np.sum(found.value_m <= 1.01 * found.value_m[0]))
    given, search = task.given, task.search
    changes = what_if(
        task.path, chosen.point_m, chosen.name, chosen.standing, search, given.candidate_m, given.sighting_floor_m
    )
    # Changes are worked out under the few sets of the search: what they multiply the accuracy by is carried over.
    base = float(accuracy(jnp.asarray(chosen.point_m), without_standing(search)))
    factor = chosen.accuracy_m[given.criterion] / base
    return PlacementAnswer(
        criterion=task.given.criterion,
        distance_m=np.asarray(points.distance_m),
        position_m=np.asarray(position_at(problem.plan, points.place)),
        layouts=layouts,
        what_if=tuple(dataclasses.replace(change, accuracy_m=factor * change.accuracy_m) for change in changes),
        sensitivity=sensitivity(chosen.point_m, task.search),
        starts=0 if found is None else len(found.value_m),
        starts_near_best=near,
    )
