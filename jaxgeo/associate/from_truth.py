"""Survey and sightings taken from a true trajectory, for recordings that have a truth but no markers."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Sightings, Survey, Trajectory
from jaxgeo.errors import SightingError, SurveyError


def survey_from_trajectory(
    truth: Trajectory, rows: Mapping[str, int], crs: str, sigma_m: float | Sequence[float]
) -> Survey:
    """Locations at the body's true positions: E, N, h are x, y, z of the truth's pose in that row.

    Raises:
        SurveyError: no rows, a row outside the truth, a sigma that is not positive.
    """
    if not rows:
        raise SurveyError("from_trajectory names no rows of the truth; expected {name: row, ...}.")
    for name, row in rows.items():
        if not 0 <= row < len(truth):
            raise SurveyError(
                f"survey.from_trajectory.rows: location '{name}': row {row} is not in the truth, which has rows 0 to "
                f"{len(truth) - 1}. Are the rows of this file, and counted from 0?"
            )
    index = np.array(list(rows.values()))
    n = len(index)
    return Survey(
        name=tuple(rows),
        enh_m=truth.position_m[index],
        sigma_m=np.tile(_sigma(sigma_m, SurveyError), (n, 1)),
        quat_grid_marker_wxyz=np.full((n, 4), np.nan),
        sigma_rot_rad=np.full((n, 3), np.nan),
        crs=crs,
    )


def sightings_from_trajectory(
    truth: Trajectory, visits: Sequence[tuple[str, int]], survey: Survey, sigma_m: float | Sequence[float]
) -> Sightings:
    """One sighting a visit: the marker at its surveyed position as the true pose of that row sees it.

    t_body_marker = R_row^T (p_location - t_row); the stamp is the row's, the marker's id is the location's name.

    Raises:
        SightingError: no visits, a row outside the truth, a location that the survey does not have, a sigma that is
            not positive.
    """
    if not visits:
        raise SightingError("from_trajectory names no visits; expected [{location, row}, ...].")
    for name, row in visits:
        if name not in survey.name:
            raise SightingError(
                f"sightings.visits: visit of '{name}' at row {row}: the survey has {', '.join(survey.name)}."
            )
        if not 0 <= row < len(truth):
            raise SightingError(
                f"sightings.visits: visit of '{name}': row {row} is not in the truth, which has rows 0 to "
                f"{len(truth) - 1}. Are the rows of this file, and counted from 0?"
            )
    names = [name for name, _ in visits]
    index = np.array([row for _, row in visits])
    surveyed = survey.enh_m[[survey.index(name) for name in names]]
    to_body = Rotation.from_quat(truth.quat_wxyz[index], scalar_first=True).inv()
    n = len(index)
    covariance = np.zeros((n, 6, 6))
    covariance[:, :3, :3] = np.diag(_sigma(sigma_m, SightingError) ** 2)
    return Sightings(
        stamp_s=truth.stamp_s[index],
        marker=np.array(names),
        t_body_marker_m=to_body.apply(surveyed - truth.position_m[index]),
        quat_body_marker_wxyz=np.full((n, 4), np.nan),
        covariance=covariance,
        ambiguous=np.zeros(n, dtype=bool),
        reprojection_px=np.full(n, np.nan),
        source=np.array([f"truth row {row} ('{name}')" for name, row in visits]),
    )


def _sigma(sigma_m: float | Sequence[float], error: type[SurveyError] | type[SightingError]) -> Float[np.ndarray, "3"]:
    sigma = np.asarray(sigma_m, dtype=np.float64)
    if sigma.shape not in ((), (3,)) or not np.all(np.isfinite(sigma) & (sigma > 0.0)):
        raise error(f"sigma_m is {sigma_m}; expected one number above zero, or three, in metres.")
    return np.broadcast_to(sigma, (3,))
