"""Anchors: visits tied to surveyed locations."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int


class Anchors(eqx.Module):
    """Visits tied to locations, sorted by pose index. What was measured and what was surveyed stay apart.

    Attributes:
        label: (k) the visits' unique names.
        location: (k) the locations' names.
        location_index: (k,) equal for visits of one location, 0 .. n_locations-1 in order of first visit.
        pose_index: (k,) the trajectory pose that carries the lever arm.
        lever_arm_m: (k, 3) marker centre in the body frame at that pose.
        lever_covariance_m2: (k, 3, 3) of the lever arm, body axes: scatter, PnP and odometry between the sightings.
        surveyed_enh_m: (k, 3) in the local frame (grid minus origin): easting, northing, height.
        survey_covariance_m2: (k, 3, 3) grid axes.
        quat_body_marker_wxyz: (k, 4) marker axes to body at that pose; NaN rows: position only.
        quat_grid_marker_wxyz: (k, 4) surveyed marker axes to grid; NaN rows: position only.
        rotation_covariance_rad2: (k, 3, 3) of both rotations together, body axes; zero for position only.
        repeatability_m: (k,) RMS of the visit's marker positions about their centroid, composed in the map frame.
        count: (k,) sightings used.
        stamp_s: (k,) stamp of the pose that carries the lever arm.
    """

    label: tuple[str, ...]
    location: tuple[str, ...]
    location_index: Int[np.ndarray, "k"]
    pose_index: Int[np.ndarray, "k"]
    lever_arm_m: Float[np.ndarray, "k 3"]
    lever_covariance_m2: Float[np.ndarray, "k 3 3"]
    surveyed_enh_m: Float[np.ndarray, "k 3"]
    survey_covariance_m2: Float[np.ndarray, "k 3 3"]
    quat_body_marker_wxyz: Float[np.ndarray, "k 4"]
    quat_grid_marker_wxyz: Float[np.ndarray, "k 4"]
    rotation_covariance_rad2: Float[np.ndarray, "k 3 3"]
    repeatability_m: Float[np.ndarray, "k"]
    count: Int[np.ndarray, "k"]
    stamp_s: Float[np.ndarray, "k"]

    def __len__(self) -> int:
        return len(self.label)
