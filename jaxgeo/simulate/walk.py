"""The true motion: a person carries the rig past surveyed locations, standing a while at each."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import RigidTransform, Rotation

from jaxgeo.simulate.layout import Layout

# The path is shaped on this raster and read between its points by cubic splines.
RASTER_S = 0.05
SMOOTHING_S = 1.5
FACING_S = 2.5 * SMOOTHING_S
# A hand-held rig tilts a little with every pace.
TILT_RAD = np.array([0.04, 0.06])
TILT_PERIOD_S = np.array([7.3, 5.1])
# Nobody stands like a tripod: what a stay moves the rig by.
SHIFT_M = np.array([0.3, -0.2, 0.05])
SWAY_M = 0.03
SWAY_PERIOD_S = 1.7


@dataclasses.dataclass(frozen=True)
class Walk:
    """The true body pose at any time between `start_s` and `end_s`; body axes x forward, y left, z up.

    Attributes:
        arrive_s, leave_s: (k,) when the rig stands before each of the visited markers.
    """

    position_m: CubicSpline
    yaw_rad: CubicSpline
    start_s: float
    end_s: float
    arrive_s: Float[np.ndarray, "k"]
    leave_s: Float[np.ndarray, "k"]

    def pose(self, stamp_s: Float[np.ndarray, "n"]) -> RigidTransform:
        """`T_local_body` at these stamps."""
        roll, pitch = TILT_RAD[:, None] * np.sin(2 * np.pi * stamp_s / TILT_PERIOD_S[:, None])
        attitude = Rotation.from_euler("ZYX", np.column_stack([self.yaw_rad(stamp_s), pitch, roll]))
        return RigidTransform.from_components(self.position_m(stamp_s), attitude)


def walk_past(marker_m: Float[np.ndarray, "k 3"], layout: Layout) -> Walk:
    """A smooth walk past the markers, in the order given, by curved ways.

    The time that the stays leave is shared among the ways, the run-in and the run-out by their lengths: one speed.

    Args:
        marker_m: the markers in the order visited, local E, N, h.
        layout: how long the rig stands before each, how far off, how high, and how far its ways bend aside.
    """
    stay_s, duration_s = np.array(layout.counts) / layout.image_rate_hz, layout.duration_s
    centre = marker_m.mean(axis=0)
    inward = (centre - marker_m) * [1.0, 1.0, 0.0]
    stand_m = marker_m + layout.standoff_m * inward / np.linalg.norm(inward, axis=1, keepdims=True)
    stand_m[:, 2] = marker_m[:, 2] + layout.rig_height_m
    chord = np.diff(stand_m, axis=0)
    chord_m = np.linalg.norm(chord, axis=1)
    # Way points to the left and right of each chord, in turn: the walk explores, it does not measure lines.
    side = np.where(np.arange(len(chord)) % 2, 1.0, -1.0)[:, None] * np.column_stack([-chord[:, 1], chord[:, 0]])
    start_m, end_m = stand_m[0] + [2.0, -2.0, 0.0], stand_m[-1] + [-2.0, 2.0, 0.0]

    way_s = np.concatenate([[np.linalg.norm(start_m - stand_m[0])], chord_m, [np.linalg.norm(end_m - stand_m[-1])]])
    way_s *= (duration_s - stay_s.sum()) / way_s.sum()
    arrive_s = np.cumsum(way_s[:-1]) + np.concatenate([[0.0], np.cumsum(stay_s[:-1])])
    leave_s = arrive_s + stay_s

    knots: list[tuple[float, np.ndarray]] = [(0.0, start_m)]
    for i, place in enumerate(stand_m):
        knots += [(arrive_s[i], place), (leave_s[i], place + SHIFT_M)]
        if i < len(chord):
            for share, shape in ((0.33, 1.0), (0.67, -0.6)):
                offset = np.append(layout.detour_share * shape * side[i], 0.0)
                knots.append((leave_s[i] + share * way_s[i + 1], place + share * chord[i] + offset))
    knots.append((duration_s, end_m))
    return _smooth_walk(knots, marker_m, duration_s, arrive_s, leave_s)


def _smooth_walk(
    knots: list[tuple[float, np.ndarray]],
    marker_m: Float[np.ndarray, "k 3"],
    duration_s: float,
    arrive_s: Float[np.ndarray, "k"],
    leave_s: Float[np.ndarray, "k"],
) -> Walk:
    stamp_s = np.arange(-2.0, duration_s + 2.0, RASTER_S)
    knot_s, knot_m = np.array([s for s, _ in knots]), np.array([m for _, m in knots])
    inside_s = np.clip(stamp_s, 0.0, duration_s)
    position_m = PchipInterpolator(knot_s, knot_m)(inside_s)
    sigma = SMOOTHING_S / RASTER_S
    position_m = gaussian_filter1d(position_m, sigma, axis=0, mode="nearest")
    position_m[:, 2] += SWAY_M * np.sin(2 * np.pi * stamp_s / SWAY_PERIOD_S)

    # Look ahead on the way (to the knot that comes next); at the marker from just before a stay to just after.
    ahead = np.minimum(np.searchsorted(knot_s, inside_s, side="right"), len(knots) - 1)
    look = (knot_m[ahead] - knot_m[ahead - 1])[:, :2]
    for i, marker in enumerate(marker_m):
        facing = (inside_s >= arrive_s[i] - FACING_S) & (inside_s <= leave_s[i] + FACING_S)
        look[facing] = (marker - position_m[facing])[:, :2]
    # As an angle, not as a vector: turning round would pass through the vector of length zero.
    yaw_rad = np.unwrap(np.arctan2(look[:, 1], look[:, 0]))
    yaw_rad = gaussian_filter1d(yaw_rad, sigma, mode="nearest")
    return Walk(CubicSpline(stamp_s, position_m), CubicSpline(stamp_s, yaw_rad), 0.0, duration_s, arrive_s, leave_s)
