"""Global corrections of a rig: its camera's clock, where its camera sits, and how it is turned.

Seven numbers, in this order: the seconds to add to every sighting's stamp for the trajectory's clock, the metres to add
to every marker's position in the body frame, and the rotation vector about the body's origin, applied before them. A
prior is a normal one about zero; a correction with a width of zero is not estimated.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.data import Sightings, Trajectory, Visit
from jaxgeo.errors import InputError
from jaxgeo.geometry.interpolate import poses_at

CORRECTIONS = (
    "time_offset_s",
    "lever_arm_x_m",
    "lever_arm_y_m",
    "lever_arm_z_m",
    "rotation_x_rad",
    "rotation_y_rad",
    "rotation_z_rad",
)
N_CORRECTIONS = len(CORRECTIONS)
TIME, ARM, ROTATION = 0, slice(1, 4), slice(4, 7)
# Half the steps over which the derivative by time may be taken. Over short ones the jitter of the odometry passes for
# motion, over long ones quick motion is lost: `corrections_difference` chooses.
DIFFERENCES_S = (0.02, 0.05, 0.1, 0.2)
FIRST_DIFFERENCE_S = 0.1


@dataclasses.dataclass(frozen=True)
class CorrectionPrior:
    """Standard deviations of the corrections before anything is seen, about zero; 0: not estimated.

    Raises:
        InputError: one is negative or not finite, or all are zero.
    """

    time_offset_s: float = 0.0
    lever_arm_m: float = 0.0
    rotation_rad: float = 0.0

    def __post_init__(self) -> None:
        widths = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        for name, width in widths.items():
            if not (np.isfinite(width) and width >= 0.0):
                raise InputError(f"correction prior {name}: {width}; expected a width of 0 (not estimated) or more.")
        if not any(widths.values()):
            raise InputError("all widths of the corrections are 0: give at least one, or do not estimate corrections.")

    @property
    def sigma(self) -> Float[np.ndarray, "7"]:
        """(7,) in the order of `CORRECTIONS`."""
        return np.array([self.time_offset_s, *[self.lever_arm_m] * 3, *[self.rotation_rad] * 3])

    @property
    def reach_s(self) -> float:
        """Offsets beyond this are not looked at: three standard deviations."""
        return 3.0 * self.time_offset_s


def corrected_sightings(sightings: Sightings, value: Float[np.ndarray, "7"]) -> Sightings:
    """The sightings as a rig with these corrections would have given them."""
    turn = Rotation.from_rotvec(value[ROTATION])
    known = np.all(np.isfinite(sightings.quat_body_marker_wxyz), axis=1)
    quat = sightings.quat_body_marker_wxyz.copy()
    if known.any():
        turned = turn * Rotation.from_quat(quat[known], scalar_first=True)
        quat[known] = turned.as_quat(scalar_first=True)
    both = np.kron(np.eye(2), turn.as_matrix())
    return dataclasses.replace(
        sightings,
        stamp_s=sightings.stamp_s + value[TIME],
        t_body_marker_m=turn.apply(sightings.t_body_marker_m) + value[ARM],
        quat_body_marker_wxyz=quat,
        covariance=both @ sightings.covariance @ both.T,
    )


def visits_within(
    trajectory: Trajectory, sightings: Sightings, visits: Sequence[Visit], reach_s: float
) -> tuple[Visit, ...]:
    """Visits without the sightings that an offset of up to `reach_s` could move out of the trajectory's time.

    So every offset is judged by the same sightings; a visit that has none left is left out.
    """
    margin_s = reach_s + max(DIFFERENCES_S)
    inside = (sightings.stamp_s >= trajectory.stamp_s[0] + margin_s) & (
        sightings.stamp_s <= trajectory.stamp_s[-1] - margin_s
    )
    kept = []
    for visit in visits:
        rows = visit.sightings[inside[visit.sightings]]
        if rows.size:
            start_s, end_s = sightings.stamp_s[rows[[0, -1]]]
            kept.append(dataclasses.replace(visit, sightings=rows, start_s=float(start_s), end_s=float(end_s)))
    return tuple(kept)


@dataclasses.dataclass(frozen=True)
class Composed:
    """Sightings composed into the map at some corrections, and how they move with them.

    Attributes:
        stamp_s: (n,) corrected.
        position_m: (n, 3) of the markers in the map frame; `jacobian` (n, 3, 7) by the corrections.
        covariance_m2: (n, 3, 3) axes of the map.
        speed_m_s, turn_rad_s: (n, 3) of the body, map axes; `R_map_body` (n, 3, 3).
    """

    stamp_s: Float[np.ndarray, "n"]
    position_m: Float[np.ndarray, "n 3"]
    jacobian: Float[np.ndarray, "n 3 7"]
    covariance_m2: Float[np.ndarray, "n 3 3"]
    speed_m_s: Float[np.ndarray, "n 3"]
    turn_rad_s: Float[np.ndarray, "n 3"]
    R_map_body: Float[np.ndarray, "n 3 3"]


def compose(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Int[np.ndarray, "m"]],
    value: Float[np.ndarray, "7"],
    difference_s: float,
) -> Composed:
    """Marker positions p = T_map_body(stamp + offset) (Exp(rotation) l + arm), and dp by the corrections.

    By time a central difference over twice `difference_s`: the marker's apparent motion in the map, the body's
    velocity plus its turning rate times the lever arm. Lever arms in derivatives are to the visit's mean position: one
    sighting's own error would be in its position and in how that moves, and pass for information.

    Args:
        visits: rows of the sightings, visit by visit; what comes back has them one after the other.

    Raises:
        SightingError: a corrected stamp lies outside the trajectory, or nearer its ends than `difference_s`.
    """
    moved = corrected_sightings(sightings.take(np.concatenate(visits)), value)
    rotation, place_m = [], []
    for shift_s in (-difference_s, 0.0, difference_s):
        poses = poses_at(trajectory, moved.stamp_s + shift_s, moved.source)
        rotation.append(Rotation.from_quat(poses.quat_wxyz, scalar_first=True))
        place_m.append(poses.position_m)
    now = rotation[1].apply(moved.t_body_marker_m) + place_m[1]
    arm_m = rotation[1].inv().apply(visit_means(now, visits) - place_m[1])
    before, after = (rotation[i].apply(arm_m) + place_m[i] for i in (0, 2))
    R_map_body = rotation[1].as_matrix()
    jacobian = np.zeros((len(now), 3, N_CORRECTIONS))
    jacobian[:, :, TIME] = (after - before) / (2.0 * difference_s)
    jacobian[:, :, ARM] = R_map_body
    jacobian[:, :, ROTATION] = -R_map_body @ _hat(arm_m - value[ARM])
    return Composed(
        stamp_s=moved.stamp_s,
        position_m=now,
        jacobian=jacobian,
        covariance_m2=R_map_body @ moved.covariance[:, :3, :3] @ np.swapaxes(R_map_body, 1, 2),
        speed_m_s=(place_m[2] - place_m[0]) / (2.0 * difference_s),
        turn_rad_s=(rotation[2] * rotation[0].inv()).as_rotvec() / (2.0 * difference_s),
        R_map_body=R_map_body,
    )


def visit_means(rows: Float[np.ndarray, "n 3"], visits: Sequence[Int[np.ndarray, "m"]]) -> Float[np.ndarray, "n 3"]:
    """Every row's mean over its visit."""
    count = np.array([len(some) for some in visits])
    mean = np.add.reduceat(rows, np.cumsum([0, *count[:-1]])) / count[:, None]
    return np.repeat(mean, count, axis=0)


@dataclasses.dataclass(frozen=True)
class Motion:
    """How the rig moved while it saw markers: what makes corrections observable.

    Attributes:
        speed_m_s, turn_rad_s: RMS of the body's.
        smear_m_s: RMS of the markers' apparent motion in the map by the second of offset; `varied_m_s` of what of it
            changes within visits.
        axis_turn: (3,) how far each body axis swings about in the map, all visits together: 0 never, 1 every way.
    """

    speed_m_s: float
    turn_rad_s: float
    smear_m_s: float
    varied_m_s: float
    axis_turn: tuple[float, float, float]


def motion_seen(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    value: Float[np.ndarray, "7"],
    difference_s: float,
) -> Motion:
    """The motion during these visits' sightings, at these corrections.

    Raises:
        SightingError: as `compose`.
    """
    rows = [visit.sightings for visit in visits]
    found = compose(trajectory, sightings, rows, value, difference_s)
    smear = found.jacobian[:, :, TIME]
    swing = np.sqrt(np.maximum(0.0, 1.0 - np.sum(found.R_map_body.mean(axis=0) ** 2, axis=0)))

    def rms(rows: Float[np.ndarray, "n 3"]) -> float:
        return float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))

    return Motion(
        speed_m_s=rms(found.speed_m_s),
        turn_rad_s=rms(found.turn_rad_s),
        smear_m_s=rms(smear),
        varied_m_s=rms(smear - visit_means(smear, rows)),
        axis_turn=(float(swing[0]), float(swing[1]), float(swing[2])),
    )


def _hat(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
