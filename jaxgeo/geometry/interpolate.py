"""Poses of a trajectory at any stamp inside it."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxgeo.data import Trajectory
from jaxgeo.errors import SightingError
from jaxgeo.geometry.padding import bucket_size, pad_rows
from jaxgeo.geometry.se3 import se3_compose, se3_exp, se3_from, se3_log, se3_parts, se3_relative


class InterpolatedPoses(NamedTuple):
    """Poses between the poses of a trajectory; NumPy from `poses_at`, JAX from `interpolate_poses`.

    Attributes:
        position_m, quat_wxyz: (m, 3), (m, 4) body to map.
        index: (m,) of the earlier of the two poses, 0 .. n-2.
        fraction: (m,) of the way to the later one, 0 .. 1.
    """

    position_m: Any
    quat_wxyz: Any
    index: Any
    fraction: Any


def pose_between(
    position_a_m: Float[Array, "*b 3"],
    quat_a_wxyz: Float[Array, "*b 4"],
    position_b_m: Float[Array, "*b 3"],
    quat_b_wxyz: Float[Array, "*b 4"],
    fraction: Float[Array, "*b"],
) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 4"]]:
    """The screw motion from a to b: `T_a Exp(fraction Log(T_a^-1 T_b))`, by the shorter turn."""
    pose_a = se3_from(position_a_m, quat_a_wxyz)
    tangent = se3_log(se3_relative(pose_a, se3_from(position_b_m, quat_b_wxyz)))
    return se3_parts(se3_compose(pose_a, se3_exp(fraction[..., None] * tangent)))


def interpolate_poses(
    stamp_s: Float[Array, "n"],
    position_m: Float[Array, "n 3"],
    quat_wxyz: Float[Array, "n 4"],
    query_s: Float[Array, "m"],
) -> InterpolatedPoses:
    """Poses at `query_s`, for traced code: differentiable in the poses and the query; the caller checks the range."""
    index = jnp.clip(jnp.searchsorted(stamp_s, query_s, side="right") - 1, 0, stamp_s.shape[0] - 2)
    fraction = (query_s - stamp_s[index]) / (stamp_s[index + 1] - stamp_s[index])
    position, quat = pose_between(
        position_m[index], quat_wxyz[index], position_m[index + 1], quat_wxyz[index + 1], fraction
    )
    return InterpolatedPoses(position, quat, index, fraction)


def poses_at(
    trajectory: Trajectory,
    query_s: Float[np.ndarray, "m"],
    source: np.ndarray | None = None,
) -> InterpolatedPoses:
    """Poses of a trajectory at stamps inside it; never extrapolates.

    Args:
        query_s: stamps on the trajectory's clock.
        source: (m,) where each stamp came from, for the message.

    Raises:
        SightingError: a stamp lies before the first or after the last pose, or is not a number.
    """
    query_s = np.asarray(query_s, dtype=np.float64)
    index, fraction = locate(trajectory, query_s, source)
    if query_s.size == 0:
        return InterpolatedPoses(np.zeros((0, 3)), np.zeros((0, 4)), index, fraction)
    size = bucket_size(query_s.size)
    ends = [rows[at] for at in (index, index + 1) for rows in (trajectory.position_m, trajectory.quat_wxyz)]
    position, quat = _pose_between(*(pad_rows(rows, size) for rows in (*ends, fraction)))
    return InterpolatedPoses(np.asarray(position)[: query_s.size], np.asarray(quat)[: query_s.size], index, fraction)


_pose_between = jax.jit(pose_between)


def locate(
    trajectory: Trajectory, query_s: Float[np.ndarray, "m"], source: np.ndarray | None = None
) -> tuple[Int[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Earlier pose and fraction for every stamp; raises SightingError as `poses_at` does."""
    stamp_s = trajectory.stamp_s
    if len(trajectory) < 2:
        raise SightingError(
            f"the trajectory has {len(trajectory)} pose(s); expected at least 2, to place {query_s.size} stamps "
            "between them. Is its file complete?"
        )
    outside = np.flatnonzero(~((query_s >= stamp_s[0]) & (query_s <= stamp_s[-1])))
    if outside.size:
        place = "" if source is None else f"{source[outside[0]]}: "
        raise SightingError(_outside_message(stamp_s, query_s, outside, place))
    index = np.clip(np.searchsorted(stamp_s, query_s, side="right") - 1, 0, len(trajectory) - 2)
    fraction = (query_s - stamp_s[index]) / (stamp_s[index + 1] - stamp_s[index])
    return index, fraction


def _outside_message(
    stamp_s: Float[np.ndarray, "n"], query_s: Float[np.ndarray, "m"], outside: Int[np.ndarray, "k"], place: str
) -> str:
    bad_s = float(query_s[outside[0]])
    if np.isnan(bad_s):
        cause = "The stamp is not a number: mend or drop that row."
    else:
        gap_s = max(float(stamp_s[0]) - bad_s, bad_s - float(stamp_s[-1]))
        if gap_s > 10.0 * float(stamp_s[-1] - stamp_s[0]):
            cause = "The clocks start at different epochs (or one is in ns or ms): bring both to the same seconds."
        else:
            cause = "Likely a clock offset between the two recordings; or drop the rows outside."
        cause = f"It lies {gap_s:.3f} s outside. {cause}"
    return (
        f"{place}stamp {bad_s:.6f} s is outside the trajectory, {stamp_s[0]:.6f} to "
        f"{stamp_s[-1]:.6f} s ({outside.size} of {query_s.size} stamps are); poses are never extrapolated. {cause}"
    )
