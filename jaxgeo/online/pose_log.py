"""The odometry so far: poses as they came, and the motions between them, ready for the estimator."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Trajectory
from jaxgeo.errors import TrajectoryError
from jaxgeo.graph.chain import Chain, Poses
from jaxgeo.graph.noise import LENGTH_FLOOR_M

# Rows of `PoseLog.columns`: the measured pose (minus the origin), the motion from the pose before, length and turn.
START_T, START_Q, STEP_T, STEP_Q, LENGTH, TURN = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 14), 14, 15
N_COLUMNS = 16
# How far the norm of a quaternion may be from 1: printed with four decimals it is within this.
_NORM_MARGIN = 1e-3
_SMALL_TURN_RAD = 1e-6


class PoseLog:
    """Poses of a drifting trajectory, one appended at a time, in arrays of fixed capacity.

    Attributes:
        capacity: poses that fit.
        columns: (16, capacity), see the constants above; what lies behind the last pose is an edge without length.
        origin_m: (3,) subtracted from the positions: the first one, in whole metres.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._n = 0
        self._stamp_s = np.zeros(capacity)
        self._position_m = np.zeros((capacity, 3))
        self._quat_wxyz = np.zeros((capacity, 4))
        self.columns = _empty_columns(capacity)
        self.origin_m = np.zeros(3)

    def __len__(self) -> int:
        return self._n

    @property
    def last_s(self) -> float:
        """Stamp of the last pose; minus infinity where there is none."""
        return float(self._stamp_s[self._n - 1]) if self._n else -math.inf

    @property
    def first_s(self) -> float:
        """Stamp of the first pose; infinity where there is none."""
        return float(self._stamp_s[0]) if self._n else math.inf

    def trajectory(self) -> Trajectory:
        """The poses so far: views, not copies."""
        n = self._n
        return Trajectory(self._stamp_s[:n], self._position_m[:n], self._quat_wxyz[:n])

    def chain(self) -> Chain:
        """Odometry and poses so far, in views of `columns`; what lies behind the last pose is no pose yet."""
        return chain_of_columns(self.columns, self.origin_m)

    def push(self, stamp_s: float, position_m: Sequence[float], quat_wxyz: Sequence[float]) -> Float[np.ndarray, "16"]:
        """Append the next pose, `T_map_body`, and return its column.

        Raises:
            TrajectoryError: a stamp not after the last one, numbers that are no pose, or no room; nothing is appended.
        """
        pose = _checked(stamp_s, position_m, quat_wxyz, self._n)
        if pose[0] <= self.last_s:
            raise TrajectoryError(
                f"pose {self._n}: stamp {pose[0]:.6f} s is not after the last one, {self.last_s:.6f} s; expected poses "
                "in the order of their stamps. Drop it, or sort them first."
            )
        if self._n == self.capacity:
            raise TrajectoryError(
                f"pose {self._n}: the log is full ({self.capacity} poses); make room with `grow` before it."
            )
        return self._append(*pose)

    def grow(self, capacity: int) -> None:
        """Make room for `capacity` poses."""
        more = capacity - self.capacity
        self._stamp_s = np.pad(self._stamp_s, (0, more))
        self._position_m = np.pad(self._position_m, ((0, more), (0, 0)))
        self._quat_wxyz = np.pad(self._quat_wxyz, ((0, more), (0, 0)))
        self.columns = np.concatenate([self.columns, _empty_columns(more)], axis=1)
        self.capacity = capacity

    def _append(self, stamp_s: float, position: list[float], quat: list[float]) -> Float[np.ndarray, "16"]:
        n = self._n
        if n == 0:
            self.origin_m = np.round(position)
        self._stamp_s[n], self._position_m[n], self._quat_wxyz[n] = stamp_s, position, quat
        column = self.columns[:, n]
        column[START_T] = self._position_m[n] - self.origin_m
        column[START_Q] = quat
        if n > 0:
            t, q = _relative(self._position_m[n - 1].tolist(), self._quat_wxyz[n - 1].tolist(), position, quat)
            column[STEP_T], column[STEP_Q] = t, q
            turn = rotation_vector(q)
            column[LENGTH] = math.hypot(*_straight(t, turn)) + LENGTH_FLOOR_M
            column[TURN] = math.hypot(*turn)
        self._n += 1
        return column


def chain_of_columns(columns: Any, map_origin_m: Any) -> Chain:
    """The chain of `PoseLog.columns`, NumPy or traced."""
    start, step = columns[START_T.start : START_Q.stop], columns[STEP_T.start : STEP_Q.stop]
    return Chain(_poses(step), _poses(start), columns[LENGTH], columns[TURN], map_origin_m)


def _poses(rows: Any) -> Poses:
    return Poses((rows[3], rows[4], rows[5], rows[6]), (rows[0], rows[1], rows[2]))


def _empty_columns(n: int) -> Float[np.ndarray, "16 n"]:
    columns = np.zeros((N_COLUMNS, n))
    columns[STEP_Q.start] = 1.0
    return columns


def _checked(
    stamp_s: float, position_m: Sequence[float], quat_wxyz: Sequence[float], row: int
) -> tuple[float, list[float], list[float]]:
    try:
        stamp, position, quat = float(stamp_s), [float(x) for x in position_m], [float(x) for x in quat_wxyz]
    except (TypeError, ValueError):
        raise TrajectoryError(
            f"pose {row}: {stamp_s!r}, {position_m!r}, {quat_wxyz!r} is no pose; expected a stamp in seconds, three "
            "numbers x, y, z and a quaternion w, x, y, z."
        ) from None
    if len(position) != 3 or len(quat) != 4:
        raise TrajectoryError(
            f"pose {row} at {stamp:.6f} s: {len(position)} position and {len(quat)} rotation numbers; expected x, y, z "
            "and a quaternion w, x, y, z."
        )
    if not all(map(math.isfinite, (stamp, *position, *quat))):
        raise TrajectoryError(
            f"pose {row}: stamp {stamp}, position {position}, quaternion {quat} is not finite. Drop the pose: the next "
            "one bridges it."
        )
    norm = math.hypot(*quat)
    if abs(norm - 1.0) > _NORM_MARGIN:
        raise TrajectoryError(
            f"pose {row} at {stamp:.6f} s: quaternion {quat} has norm {norm:.6g}; expected 1, in the order w, x, y, z. "
            "Normalise it, or drop the pose."
        )
    return stamp, position, [x / norm for x in quat]


def _relative(
    t0: list[float], q0: list[float], t1: list[float], q1: list[float]
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """The motion from pose 0 to pose 1, in the frame of pose 0. Plain floats: NumPy's calls cost more than this."""
    w, x, y, z = q0[0], -q0[1], -q0[2], -q0[3]
    a, b, c, d = q1
    quat = (w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b)
    quat = (*quat, w * d + x * c - y * b + z * a)
    vx, vy, vz = t1[0] - t0[0], t1[1] - t0[1], t1[2] - t0[2]
    ux, uy, uz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    t = (
        vx + w * ux + y * uz - z * uy,
        vy + w * uy + z * ux - x * uz,
        vz + w * uz + x * uy - y * ux,
    )
    return t, quat


def rotation_vector(quat_wxyz: Sequence[float]) -> tuple[float, float, float]:
    """Rotation vector of a unit quaternion, by the shorter turn."""
    w, x, y, z = quat_wxyz
    sine = math.hypot(x, y, z)
    factor = 2.0 / w if sine < _SMALL_TURN_RAD else 2.0 * math.atan2(math.copysign(sine, w), abs(w)) / sine
    return factor * x, factor * y, factor * z


def _straight(t: Sequence[float], w: Sequence[float]) -> tuple[float, float, float]:
    """Translation part of the motion's logarithm: `t - w x t / 2 + c w x (w x t)` (Barfoot 2017, eq. 7.38)."""
    t2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    half = 0.5 * math.sqrt(t2)
    c = 1.0 / 12.0 + t2 / 720.0 if t2 < 1e-4 else (1.0 - half / math.tan(half)) / t2
    once = _cross(w, t)
    twice = _cross(w, once)
    return tuple(t[i] - 0.5 * once[i] + c * twice[i] for i in range(3))  # type: ignore[return-value]


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
