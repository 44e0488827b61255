"""A cloud carried with the correction of the trajectory that made it: each point moves with the pose that saw it.

Pose i went from `T_before_i` to `T_after_i`, so what it saw moves by `C_i = T_after_i T_before_i^-1`. Between two poses
the correction is interpolated along the screw motion from C_k to C_k+1. Written about pose k,

    C(f) = T_after_k Exp(f x_k) T_before_k^-1,   x_k = Log(O_after_k O_before_k^-1),   O_k = T_k^-1 T_k+1,

it holds small numbers only: what the edge k changed by, and the point as its pose saw it. So it loses no digits,
however large the coordinates are. Moving the cloud by one rigid transform instead leaves the trajectory's bends in it.
"""

import dataclasses
import warnings

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxgeo.data import Trajectory
from jaxgeo.errors import CloudError
from jaxgeo.geometry.padding import bucket_size, pad_rows
from jaxgeo.graph.se3_soa import exp, log
from jaxgeo.graph.soa import Quat, Vec3, add, quat_conj, quat_mul, rotate, scale, sub
from jaxgeo.io.input_warning import InputWarning
from jaxgeo.precision import assert_float64

SAME_STAMP_S = 1e-3
LEAST_HOLD_S = 0.2  # two turns of a LiDAR: its points are stamped up to one turn before and after their pose
_BLOCK = 1 << 17  # points in one call: what lies between its steps stays in the cache


@dataclasses.dataclass(frozen=True)
class PoseCorrections:
    """The poses that both trajectories have, before and after.

    Attributes:
        stamp_s: (m,) m at least 2.
        before_m, before_wxyz: (m, 3), (m, 4), times `scale`.
        after_m, after_wxyz: (m, 3), (m, 4).
        change: (m-1, 6) x_k of the file's head, (translation, rotation).
        scale: metres in a unit of the map.
        before_stamp_s: (n,) of all poses before, which `pose_index` counts.
    """

    stamp_s: Float[np.ndarray, "m"]
    before_m: Float[np.ndarray, "m 3"]
    before_wxyz: Float[np.ndarray, "m 4"]
    after_m: Float[np.ndarray, "m 3"]
    after_wxyz: Float[np.ndarray, "m 4"]
    change: Float[np.ndarray, "l 6"]
    scale: float
    before_stamp_s: Float[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.stamp_s)


@dataclasses.dataclass(frozen=True)
class Place:
    """Where on the trajectory points were seen.

    Attributes:
        index: (n,) of the earlier pose of `PoseCorrections`.
        fraction: (n,) of the way to the next one, 0 .. 1.
    """

    index: Int[np.ndarray, "n"]
    fraction: Float[np.ndarray, "n"]


def pose_corrections(before: Trajectory, after: Trajectory, scale: float = 1.0) -> PoseCorrections:
    """Pair the poses of two trajectories by their stamps.

    Args:
        before: the poses that the cloud was made with, in the cloud's frame.
        after: the same poses, corrected; some may be missing.
        scale: metres in a unit of `before` and its cloud: 1 but for maps without a metre (one camera). Ranges
            are stretched by it about their pose.

    Raises:
        CloudError: fewer than two poses have a partner within a millisecond, or the scale is not positive.

    Warns:
        InputWarning: of poses without a partner; the correction is interpolated over them.
    """
    if not (np.isfinite(scale) and scale > 0.0):
        raise CloudError(f"scale {scale}; expected the metres in a unit of the map, a positive number.")
    i, j = _pairs(before.stamp_s, after.stamp_s)
    if len(i) < 2:
        raise CloudError(
            f"{len(i)} of {len(before)} poses before have the stamp of one of the {len(after)} poses after; expected "
            f"at least 2. Before: {_span(before)}, after: {_span(after)}. Are they the same trajectory, on one clock?"
        )
    if len(i) < len(before):
        warnings.warn(
            f"{len(before) - len(i)} of {len(before)} poses before have no partner after; the correction is "
            "interpolated over them.",
            InputWarning,
            stacklevel=2,
        )
    ends = (scale * before.position_m[i], before.quat_wxyz[i], after.position_m[j], after.quat_wxyz[j])
    return PoseCorrections(before.stamp_s[i], *ends, _changes(*ends), scale, before.stamp_s)


def places_by_stamp(
    corrections: PoseCorrections, stamp_s: Float[np.ndarray, "n"], hold_s: float | None = None
) -> tuple[Place, Bool[np.ndarray, "n"]]:
    """Where points with these stamps were seen, and which lie within the trajectory.

    Up to `hold_s` before the first and after the last pose, that pose's correction is held; default: the usual step
    between poses, at least 0.2 s. Beyond, and for stamps that are not numbers, the second answer is False.
    """
    stamps = corrections.stamp_s
    hold_s = default_hold_s(corrections) if hold_s is None else hold_s
    stamp_s = np.asarray(stamp_s, dtype=np.float64)
    inside = (stamp_s >= stamps[0] - hold_s) & (stamp_s <= stamps[-1] + hold_s)
    held = np.clip(np.where(inside, stamp_s, stamps[0]), stamps[0], stamps[-1])
    index = np.clip(np.searchsorted(stamps, held, side="right") - 1, 0, len(stamps) - 2)
    return Place(index, (held - stamps[index]) / (stamps[index + 1] - stamps[index])), inside


def places_by_index(
    corrections: PoseCorrections, pose_index: Int[np.ndarray, "n"]
) -> tuple[Place, Bool[np.ndarray, "n"]]:
    """Where points seen from these poses (rows of the trajectory before, from 0) were seen, and which poses exist.

    A pose without a partner after has the correction of its stamp.
    """
    n = len(corrections.before_stamp_s)
    known = (pose_index >= 0) & (pose_index < n)
    row = np.where(known, pose_index, 0)
    place, inside = places_by_stamp(corrections, corrections.before_stamp_s)
    return Place(place.index[row], place.fraction[row]), known & inside[row]


def default_hold_s(corrections: PoseCorrections) -> float:
    return max(LEAST_HOLD_S, float(np.median(np.diff(corrections.stamp_s))))


def carry(corrections: PoseCorrections, points_m: Float[np.ndarray, "n 3"], place: Place) -> Float[np.ndarray, "n 3"]:
    """The points, in the frame of the trajectory after: `C(f) (scale p)`."""
    return _in_blocks(_carried, corrections, corrections.scale * points_m, place)


def turn(corrections: PoseCorrections, normal: Float[np.ndarray, "n 3"], place: Place) -> Float[np.ndarray, "n 3"]:
    """Directions, in the frame of the trajectory after: the rotation of C(f) alone."""
    return _in_blocks(_turned, corrections, normal, place)


def _in_blocks(function, corrections: PoseCorrections, vectors, place: Place) -> Float[np.ndarray, "n 3"]:
    assert_float64()
    tables = _tables(corrections)
    vectors = np.asarray(vectors, dtype=np.float64)
    out = np.empty_like(vectors)
    for start in range(0, len(vectors), _BLOCK):
        rows = slice(start, start + _BLOCK)
        block = (vectors[rows], place.index[rows], np.asarray(place.fraction[rows], dtype=np.float64))
        size = bucket_size(len(block[0]))
        vector, index, fraction = (pad_rows(part, size) for part in block)
        found = function(tables, tuple(vector.T), index, fraction)
        out[rows] = np.column_stack(found)[: len(block[0])]
    return out


_Tables = tuple[Vec3, Quat, Vec3, Quat, Vec3, Vec3]


def _tables(c: PoseCorrections) -> _Tables:
    """Components of all poses, padded so that trajectories of similar length share one program."""
    size = bucket_size(len(c))
    change = pad_rows(c.change, size)
    poses = (pad_rows(part, size) for part in (c.before_m, c.before_wxyz, c.after_m, c.after_wxyz))
    return tuple(tuple(part.T) for part in (*poses, change[:, :3], change[:, 3:]))  # type: ignore[return-value]


@jax.jit
def _carried(tables: _Tables, point: Vec3, index, fraction) -> Vec3:
    before, q_before, after, q_after, shift, turned = _at(tables, index)
    seen = rotate(quat_conj(q_before), sub(point, before))
    q, t = exp(scale(fraction, shift), scale(fraction, turned))
    return add(rotate(q_after, add(rotate(q, seen), t)), after)


@jax.jit
def _turned(tables: _Tables, direction: Vec3, index, fraction) -> Vec3:
    _, q_before, _, q_after, shift, turned = _at(tables, index)
    q, _ = exp(scale(fraction, shift), scale(fraction, turned))
    return rotate(quat_mul(q_after, q), rotate(quat_conj(q_before), direction))


def _at(tables: _Tables, index) -> _Tables:
    return jax.tree.map(lambda component: component[index], tables)


def _changes(before_m, before_wxyz, after_m, after_wxyz) -> Float[np.ndarray, "l 6"]:
    """x_k of the file's head for all edges."""
    n, size = len(before_m) - 1, bucket_size(len(before_m))
    ends = (tuple(pad_rows(part, size).T) for part in (before_m, before_wxyz, after_m, after_wxyz))
    translation, rotation = _edge_changes(*ends)
    return np.column_stack([*translation, *rotation])[:n]


@jax.jit
def _edge_changes(before: Vec3, q_before: Quat, after: Vec3, q_after: Quat) -> tuple[Vec3, Vec3]:
    def edges(position: Vec3, quat: Quat) -> tuple[Quat, Vec3]:
        first, second = (jax.tree.map(lambda c, s=s: c[s], (quat, position)) for s in (slice(-1), slice(1, None)))
        inverse = quat_conj(first[0])
        return quat_mul(inverse, second[0]), rotate(inverse, sub(second[1], first[1]))

    (q_b, t_b), (q_a, t_a) = edges(before, q_before), edges(after, q_after)
    q = quat_mul(q_a, quat_conj(q_b))
    return log(q, sub(t_a, rotate(q, t_b)))


def _span(trajectory: Trajectory) -> str:
    return f"{trajectory.stamp_s[0]:.6f} to {trajectory.stamp_s[-1]:.6f} s"


def _pairs(a_s: Float[np.ndarray, "n"], b_s: Float[np.ndarray, "k"]) -> tuple[Int[np.ndarray, "m"], ...]:
    """Indices of equal stamps; each used once, since no step of a or b is shorter than twice the tolerance."""
    if min(len(a_s), len(b_s)) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    tolerance_s = min(SAME_STAMP_S, 0.45 * float(np.diff(a_s).min()), 0.45 * float(np.diff(b_s).min()))
    right = np.clip(np.searchsorted(b_s, a_s), 1, len(b_s) - 1)
    nearest = right - (a_s - b_s[right - 1] <= b_s[right] - a_s)
    found = np.flatnonzero(np.abs(a_s - b_s[nearest]) <= tolerance_s)
    return found, nearest[found]
