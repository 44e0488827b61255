"""A recorded session pushed through `OnlineGeoreference` in the order of its stamps, and what was known when."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.data import Sightings, Trajectory
from jaxgeo.online.georeference import OnlineGeoreference
from jaxgeo.online.online_pose import OnlinePose, OnlineResult, Status, Update


@dataclasses.dataclass(frozen=True)
class Replayed:
    """What was known at every pose, right after it was pushed; then the end.

    Attributes:
        stamp_s: (n,) of the poses.
        enh_m, quat_wxyz: (n, 3), (n, 4) in the grid; NaN while undetermined.
        sigma: (n, 6) standard deviations, metres and radians, about the grid axes.
        n_anchors, anchor_age_s: (n,) visits in use, and the time since the last.
        status: (n) words.
        latency_s: of every push by its kind: `odometry`, `sighting`, `current`, `anchor` (updates that made an anchor)
            and `idle` (updates that had nothing to do).
        anchor_processor_s: processor time of the updates under `anchor`, all cores together: nearer to what they take
            than the clock is, on a machine that others use too.
        behind_s: (n,) how late each pose was pushed, where a rate was kept; else zero.
        result: the end.
    """

    stamp_s: Float[np.ndarray, "n"]
    enh_m: Float[np.ndarray, "n 3"]
    quat_wxyz: Float[np.ndarray, "n 4"]
    sigma: Float[np.ndarray, "n 6"]
    n_anchors: Int[np.ndarray, "n"]
    anchor_age_s: Float[np.ndarray, "n"]
    status: tuple[Status, ...]
    latency_s: dict[str, Float[np.ndarray, "m"]]
    anchor_processor_s: Float[np.ndarray, "m"]
    behind_s: Float[np.ndarray, "n"]
    result: OnlineResult


def replay(
    georeference: OnlineGeoreference,
    trajectory: Trajectory,
    sightings: Sightings,
    *,
    rate: float | None = None,
    after_pose: Callable[[OnlinePose, Update | None, float], None] | None = None,
) -> Replayed:
    """Push everything, and finish.

    Args:
        rate: seconds of the recording a second; None: as fast as it goes.
        after_pose: told of every pose, of the update that came with it, and of that update's seconds.

    Raises:
        JaxgeoError: as `OnlineGeoreference`'s methods.
    """
    latency: dict[str, list[float]] = {kind: [] for kind in ("odometry", "sighting", "current", "anchor", "idle")}
    known: list[OnlinePose] = []
    processor: list[float] = []
    behind = np.zeros(len(trajectory))
    order = np.argsort(sightings.stamp_s, kind="stable")
    due = np.searchsorted(sightings.stamp_s[order], trajectory.stamp_s, side="right")
    began, pushed = time.perf_counter(), 0
    for i, stamp_s in enumerate(trajectory.stamp_s):
        if rate is not None:
            behind[i] = _wait_until(began + (stamp_s - trajectory.stamp_s[0]) / rate)
        for row in order[pushed : due[i]]:
            _timed(latency["sighting"], georeference.push_sightings, sightings.take(np.array([row])))
        pushed = due[i]
        _timed(
            latency["odometry"], georeference.push_odometry, stamp_s, trajectory.position_m[i], trajectory.quat_wxyz[i]
        )
        busy_s = time.process_time()
        update, took_s = _updated(georeference)
        if update is not None:
            processor.append(time.process_time() - busy_s)
        latency["idle" if update is None else "anchor"].append(took_s)
        known.append(_timed(latency["current"], georeference.current))
        if after_pose is not None:
            after_pose(known[-1], update, took_s)
    for row in order[pushed:]:
        georeference.push_sightings(sightings.take(np.array([row])))
    times = {kind: np.array(values) for kind, values in latency.items()}
    return _gathered(known, times, np.array(processor), behind, georeference.finish())


def _timed(into: list[float], call: Callable, *arguments: object) -> Any:
    start = time.perf_counter()
    found = call(*arguments)
    into.append(time.perf_counter() - start)
    return found


def _updated(georeference: OnlineGeoreference) -> tuple[Update | None, float]:
    start = time.perf_counter()
    update = georeference.update()
    return update, time.perf_counter() - start


def _wait_until(due: float) -> float:
    """Sleep until the moment; by how much it was missed."""
    left = due - time.perf_counter()
    if left > 0:
        time.sleep(left)
    return max(time.perf_counter() - due, 0.0)


def _gathered(
    known: list[OnlinePose],
    latency_s: dict[str, Float[np.ndarray, "m"]],
    anchor_processor_s: Float[np.ndarray, "m"],
    behind_s: Float[np.ndarray, "n"],
    result: OnlineResult,
) -> Replayed:
    return Replayed(
        stamp_s=np.array([pose.stamp_s for pose in known]),
        enh_m=np.array([pose.enh_m for pose in known]),
        quat_wxyz=np.array([pose.quat_wxyz for pose in known]),
        sigma=np.sqrt(np.array([np.diag(pose.covariance) for pose in known])),
        n_anchors=np.array([pose.n_anchors for pose in known]),
        anchor_age_s=np.array([pose.anchor_age_s for pose in known]),
        status=tuple(pose.status for pose in known),
        latency_s=latency_s,
        anchor_processor_s=anchor_processor_s,
        behind_s=behind_s,
        result=result,
    )
