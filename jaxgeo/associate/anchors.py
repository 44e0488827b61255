"""Visits to anchors: sightings composed through the trajectory, brought to one lever arm at one pose."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.associate.centroid import CentroidRule, visit_centroid, weighted_median
from jaxgeo.associate.time_range import pauses_met, within_trajectory
from jaxgeo.data import Anchors, Sightings, Survey, Trajectory, Visit
from jaxgeo.errors import SightingError
from jaxgeo.geometry.interpolate import poses_at

_MOST_CANDIDATES = 100  # rotations tried as the start of the rotation mean


@dataclasses.dataclass(frozen=True)
class _Seen:
    """Sightings composed into the map frame: markers' positions and rotations, error axes of the map."""

    stamp_s: Float[np.ndarray, "n"]
    position_m: Float[np.ndarray, "n 3"]
    covariance_m2: Float[np.ndarray, "n 3 3"]
    rotation: Float[np.ndarray, "n 3 3"]
    rotation_covariance_rad2: Float[np.ndarray, "n 3 3"]
    rotation_known: Bool[np.ndarray, "n"]

    def take(self, index: Int[np.ndarray, "m"]) -> "_Seen":
        return _Seen(**{field.name: getattr(self, field.name)[index] for field in dataclasses.fields(self)})


def make_anchors(
    trajectory: Trajectory,
    sightings: Sightings,
    visits: Sequence[Visit],
    survey: Survey,
    *,
    origin_enh_m: Sequence[float] | Float[np.ndarray, "3"],
    rule: CentroidRule | None = None,
) -> tuple[Anchors, tuple[str, ...]]:
    """One anchor a labelled visit, sorted by pose index, and warnings.

    Each sighting's marker is composed through the interpolated trajectory. The reference pose is the one at or before
    the information-weighted median stamp of the visit; the lever arm is the robust centroid (see `centroid`) in that
    pose's body frame. The marker's rotation is kept where the survey has one too and at least one sighting of
    the visit is unambiguous: ambiguous sightings serve for position alone, where their two solutions hardly differ.

    Args:
        origin_enh_m: of the local frame, subtracted from the survey.
        rule: how sightings are weighted and what the covariance may claim; default `CentroidRule()`.

    Raises:
        SightingError: an unlabelled visit; a location that the survey does not have; sightings outside the
            trajectory's time (up to 5 % of them are left out with a warning); a covariance that is not positive.
    """
    rule = rule or CentroidRule()
    _check_visits(sightings, visits, survey)
    visits, warnings = within_trajectory(trajectory, sightings, visits)
    warnings += pauses_met(trajectory, sightings, visits)
    seen = _compose(trajectory, sightings, np.concatenate([visit.sightings for visit in visits]))
    ends = np.cumsum([visit.count for visit in visits])
    rows = [
        _anchor(trajectory, seen.take(np.arange(end - visit.count, end)), survey, survey.index(visit.location), rule)
        for visit, end in zip(visits, ends, strict=True)
    ]
    surveyed = np.array([survey.index(visit.location) for visit in visits])
    order = np.argsort([row["pose_index"] for row in rows], kind="stable")
    first_visit = list(dict.fromkeys(visit.location for visit in sorted(visits, key=lambda visit: visit.start_s)))
    columns = {name: np.array([rows[i][name] for i in order]) for name in rows[0]}
    anchors = Anchors(
        label=tuple(visits[i].label for i in order),
        location=tuple(visits[i].location for i in order),
        location_index=np.array([first_visit.index(visits[i].location) for i in order]),
        surveyed_enh_m=survey.enh_m[surveyed[order]] - np.asarray(origin_enh_m, dtype=np.float64),
        survey_covariance_m2=survey.sigma_m[surveyed[order], :, None] ** 2 * np.eye(3),
        stamp_s=trajectory.stamp_s[columns["pose_index"]],
        **columns,
    )
    return anchors, warnings


def _anchor(trajectory: Trajectory, seen: _Seen, survey: Survey, location: int, rule: CentroidRule) -> dict[str, Any]:
    """The columns of `Anchors` that come from one visit."""
    information = 1.0 / np.trace(seen.covariance_m2, axis1=1, axis2=2)
    middle_s = weighted_median(seen.stamp_s, information)
    index = int(np.searchsorted(trajectory.stamp_s, middle_s, side="right")) - 1
    reference_s = float(trajectory.stamp_s[index])
    to_body = Rotation.from_quat(trajectory.quat_wxyz[index], scalar_first=True).as_matrix().T
    centroid = visit_centroid(seen.stamp_s, seen.position_m, seen.covariance_m2, reference_s, rule, rule.floor_m)
    about = seen.position_m - seen.position_m.mean(axis=0)
    row = {
        "pose_index": index,
        "lever_arm_m": to_body @ (centroid.mean - trajectory.position_m[index]),
        "lever_covariance_m2": to_body @ centroid.covariance @ to_body.T,
        "quat_body_marker_wxyz": np.full(4, np.nan),
        "quat_grid_marker_wxyz": np.full(4, np.nan),
        "rotation_covariance_rad2": np.zeros((3, 3)),
        "repeatability_m": float(np.sqrt(np.mean(np.sum(about**2, axis=1)))),
        "count": len(seen.stamp_s),
    }
    quat_grid_marker = survey.quat_grid_marker_wxyz[location]
    if seen.rotation_known.any() and np.all(np.isfinite(quat_grid_marker)):
        R_map_marker, covariance = _mean_rotation(seen, reference_s, rule)
        R_body_marker = to_body @ R_map_marker
        R_body_grid = R_body_marker @ Rotation.from_quat(quat_grid_marker, scalar_first=True).as_matrix().T
        surveyed = R_body_grid @ np.diag(survey.sigma_rot_rad[location] ** 2) @ R_body_grid.T
        row["quat_body_marker_wxyz"] = Rotation.from_matrix(R_body_marker).as_quat(scalar_first=True)
        row["quat_grid_marker_wxyz"] = quat_grid_marker
        row["rotation_covariance_rad2"] = to_body @ covariance @ to_body.T + surveyed
    return row


def _mean_rotation(
    seen: _Seen, reference_s: float, rule: CentroidRule
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Robust mean of the visit's rotations, from the one nearest to all others, by the rule of `centroid`."""
    known = np.flatnonzero(seen.rotation_known)
    rotations, covariance = seen.rotation[known], seen.rotation_covariance_rad2[known]
    few = np.unique(np.linspace(0, len(known) - 1, min(len(known), _MOST_CANDIDATES)).round().astype(int))
    cosine = np.clip((np.einsum("aij,bij->ab", rotations[few], rotations) - 1.0) / 2.0, -1.0, 1.0)
    mean = rotations[few[np.argmin(np.arccos(cosine).sum(axis=1))]]
    for _ in range(5):
        error = Rotation.from_matrix(rotations @ mean.T).as_rotvec()
        centroid = visit_centroid(seen.stamp_s[known], error, covariance, reference_s, rule, rule.floor_rad)
        mean = Rotation.from_rotvec(centroid.mean).as_matrix() @ mean
        if np.linalg.norm(centroid.mean) < 1e-10:
            break
    return mean, centroid.covariance


def _compose(trajectory: Trajectory, sightings: Sightings, rows: Int[np.ndarray, "n"]) -> _Seen:
    poses = poses_at(trajectory, sightings.stamp_s[rows], sightings.source[rows])
    R_map_body = Rotation.from_quat(poses.quat_wxyz, scalar_first=True).as_matrix()
    quat_body_marker = sightings.quat_body_marker_wxyz[rows]
    known = np.all(np.isfinite(quat_body_marker), axis=1)
    quat_body_marker = np.where(known[:, None], quat_body_marker, [1.0, 0.0, 0.0, 0.0])
    to_body = np.swapaxes(R_map_body, 1, 2)
    return _Seen(
        stamp_s=sightings.stamp_s[rows],
        position_m=poses.position_m + np.einsum("nij,nj->ni", R_map_body, sightings.t_body_marker_m[rows]),
        covariance_m2=R_map_body @ sightings.covariance[rows, :3, :3] @ to_body,
        rotation=R_map_body @ Rotation.from_quat(quat_body_marker, scalar_first=True).as_matrix(),
        rotation_covariance_rad2=R_map_body @ sightings.covariance[rows, 3:, 3:] @ to_body,
        rotation_known=known & ~sightings.ambiguous[rows],
    )


def _check_visits(sightings: Sightings, visits: Sequence[Visit], survey: Survey) -> None:
    if not visits:
        raise SightingError("there are no visits to make anchors of.")
    for visit in visits:
        if visit.location not in survey.name:
            raise SightingError(
                f"visit from {visit.start_s:.3f} to {visit.end_s:.3f} s (marker '{visit.marker}') is tied to "
                f"location '{visit.location}', which the survey does not have; label the visits first."
            )
    used = np.concatenate([visit.sightings for visit in visits])
    smallest = np.linalg.eigvalsh(sightings.covariance[used, :3, :3])[:, 0]
    bad = used[~(smallest > 0.0)]
    if bad.size:
        raise SightingError(
            f"{sightings.source[bad[0]]}: the position covariance of the sighting is not positive definite "
            f"({bad.size} such sightings); give each a standard deviation above zero."
        )
