"""A trajectory against a reference: absolute and relative errors (Sturm et al. 2012; Zhang and Scaramuzza 2018)."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.export.result import ReferenceError
from jaxgeo.geometry import bucket_size, pad_rows, poses_at, sim3_apply_trajectory, umeyama

Align = Literal["none", "se3", "sim3"]
Pairs = Literal["all", "consecutive"]
_WITHIN = 0.1  # of the distance: how far a pair's path may differ from it


@dataclasses.dataclass(frozen=True)
class RelativeError:
    """Drift over pairs of poses that lie one distance apart along the reference.

    Attributes:
        distance_m: nominal path length between the two poses.
        count: pairs; with none the two errors are NaN.
        translation_rmse_m, rotation_rmse_rad: of the relative motion's error.
    """

    distance_m: float
    count: int
    translation_rmse_m: float
    rotation_rmse_rad: float


def associate(
    stamp_s: Float[np.ndarray, "n"], reference_stamp_s: Float[np.ndarray, "r"], max_gap_s: float
) -> Bool[np.ndarray, "n"]:
    """Which stamps lie between two reference stamps no further apart than `max_gap_s`, or on one."""
    right = np.clip(np.searchsorted(reference_stamp_s, stamp_s, side="left"), 1, len(reference_stamp_s) - 1)
    before, after = reference_stamp_s[right - 1], reference_stamp_s[right]
    inside = (stamp_s >= before) & (stamp_s <= after)
    return inside & ((after - before <= max_gap_s) | (stamp_s == before) | (stamp_s == after))


def absolute_error(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    t_body_reference_m: Sequence[float] = (0.0, 0.0, 0.0),
    align: Align = "se3",
    max_gap_s: float = 1.0,
) -> ReferenceError:
    """Distances between the reference's body, carried along by the estimate, and where the reference has it.

    The reference is interpolated at the estimate's stamps; stamps outside it or in its gaps are left out: `n_poses`
    counts those that remain.

    Args:
        t_body_reference_m: origin of the reference's body in the estimate's body frame.
        align: `none` where both are in one frame; else the estimate is first fitted to the reference, all poses equal.

    Raises:
        TrajectoryError: fewer than 3 stamps in common.
    """
    kept, matched = _match(estimate, reference, max_gap_s)
    carried = _carry(kept, t_body_reference_m, (0.0, 0.0, 0.0))
    if align != "none":
        carried = _aligned(carried, matched, scale=align == "sim3")
    error_m = np.linalg.norm(carried.position_m - matched.position_m, axis=1)
    return ReferenceError(
        ate_rmse_m=float(np.sqrt(np.mean(error_m**2))),
        ate_median_m=float(np.median(error_m)),
        n_poses=len(error_m),
        error_m=error_m,
        stamp_s=kept.stamp_s,
        aligned=align != "none",
    )


def relative_errors(
    estimate: Trajectory,
    reference: Trajectory,
    distances_m: Sequence[float],
    *,
    t_body_reference_m: Sequence[float] = (0.0, 0.0, 0.0),
    rotvec_body_reference_rad: Sequence[float] = (0.0, 0.0, 0.0),
    max_gap_s: float = 1.0,
    pairs: Pairs = "all",
) -> tuple[RelativeError, ...]:
    """Drift over each distance: error of the motion between pairs that far apart along the reference; no alignment.

    Args:
        pairs: `all`: every pose with the one nearest to the distance, within a tenth of it; they overlap.
            `consecutive`: from the first pose to the first at least that far on, from there to the next, ...; over
            distance 0 all successive poses.
        t_body_reference_m, rotvec_body_reference_rad: pose of the reference's body in the estimate's body frame.

    Raises:
        TrajectoryError: fewer than 3 stamps in common.
    """
    kept, matched = _match(estimate, reference, max_gap_s)
    carried = _carry(kept, t_body_reference_m, rotvec_body_reference_rad)
    steps_m = np.linalg.norm(np.diff(matched.position_m, axis=0), axis=1)
    path_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    return tuple(_over_distance(carried, matched, path_m, distance, pairs) for distance in distances_m)


def _match(estimate: Trajectory, reference: Trajectory, max_gap_s: float) -> tuple[Trajectory, Trajectory]:
    """The estimate's poses that have a reference, and the reference at their stamps."""
    if len(reference) < 2:
        raise TrajectoryError(f"the reference has {len(reference)} pose(s); expected at least 2.")
    keep = associate(estimate.stamp_s, reference.stamp_s, max_gap_s)
    if keep.sum() < 3:
        raise TrajectoryError(
            f"the reference ({reference.stamp_s[0]:.3f} to {reference.stamp_s[-1]:.3f} s) covers {keep.sum()} stamps "
            f"of the trajectory ({estimate.stamp_s[0]:.3f} to {estimate.stamp_s[-1]:.3f} s), gaps above {max_gap_s} s "
            "left out; expected at least 3. Likely two clocks or epochs, or the wrong reference file."
        )
    stamp_s = estimate.stamp_s[keep]
    found = poses_at(reference, stamp_s)
    kept = Trajectory(stamp_s, estimate.position_m[keep], estimate.quat_wxyz[keep])
    return kept, Trajectory(stamp_s, found.position_m, found.quat_wxyz)


def _carry(trajectory: Trajectory, t_m: Sequence[float], rotvec_rad: Sequence[float]) -> Trajectory:
    """The trajectory of another body frame that is fixed to its body."""
    turn = _rotation(trajectory.quat_wxyz)
    position_m = trajectory.position_m + turn.apply(np.asarray(t_m, dtype=np.float64))
    quat_wxyz = (turn * Rotation.from_rotvec(rotvec_rad)).as_quat(scalar_first=True)
    return Trajectory(trajectory.stamp_s, position_m, quat_wxyz)


def _aligned(trajectory: Trajectory, reference: Trajectory, scale: bool) -> Trajectory:
    # Padded with weight zero, so that a session of another length does not compile anew.
    size = bucket_size(len(trajectory))
    weights = np.zeros(size)
    weights[: len(trajectory)] = 1.0
    source, target = pad_rows(trajectory.position_m, size), pad_rows(reference.position_m, size)
    fit = umeyama(jnp.asarray(source), jnp.asarray(target), jnp.asarray(weights), scale=scale)
    return sim3_apply_trajectory(fit.sim3, trajectory)


def _over_distance(
    estimate: Trajectory, reference: Trajectory, path_m: Float[np.ndarray, "n"], distance_m: float, pairs: Pairs
) -> RelativeError:
    first, second = (_all_pairs if pairs == "all" else _consecutive_pairs)(path_m, distance_m)
    if first.size == 0:
        return RelativeError(distance_m, 0, float("nan"), float("nan"))
    moved_m, turned = _motion(estimate, first, second)
    moved_reference_m, turned_reference = _motion(reference, first, second)
    angle_rad = (turned_reference.inv() * turned).magnitude()
    return RelativeError(
        distance_m,
        int(first.size),
        float(np.sqrt(np.mean(np.sum((moved_m - moved_reference_m) ** 2, axis=1)))),
        float(np.sqrt(np.mean(angle_rad**2))),
    )


def _motion(
    trajectory: Trajectory, first: Int[np.ndarray, "p"], second: Int[np.ndarray, "p"]
) -> tuple[Float[np.ndarray, "p 3"], Rotation]:
    """Translation and rotation of the later pose, seen from the earlier."""
    back = _rotation(trajectory.quat_wxyz[first]).inv()
    moved_m = back.apply(trajectory.position_m[second] - trajectory.position_m[first])
    return moved_m, back * _rotation(trajectory.quat_wxyz[second])


def _rotation(quat_wxyz: Float[np.ndarray, "n 4"]) -> Rotation:
    return Rotation.from_quat(quat_wxyz, scalar_first=True)


def _all_pairs(path_m: Float[np.ndarray, "n"], distance_m: float) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """For every pose the later one whose path is nearest to `distance_m`, where one is within a tenth of it."""
    first = np.arange(len(path_m))
    goal_m = path_m + distance_m
    above = np.clip(np.searchsorted(path_m, goal_m), 1, len(path_m) - 1)
    nearer_below = goal_m - path_m[above - 1] <= path_m[above] - goal_m
    second = np.where(nearer_below, above - 1, above)
    good = (second > first) & (np.abs(path_m[second] - goal_m) <= _WITHIN * distance_m)
    return first[good], second[good]


def _consecutive_pairs(
    path_m: Float[np.ndarray, "n"], distance_m: float
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """From the first pose on, the next whose path is at least `distance_m` longer; they share ends and no motion."""
    at = [0]
    while True:
        following = max(int(np.searchsorted(path_m, path_m[at[-1]] + distance_m)), at[-1] + 1)
        if following >= len(path_m):
            return np.array(at[:-1], dtype=int), np.array(at[1:], dtype=int)
        at.append(following)
