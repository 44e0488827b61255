"""Are the survey's E and N exchanged? The numbers do not tell (in LUREF they have one size), but the shape may.

Exchanged axes mirror the layout. A mirrored layout with relief fits badly: refused. One on flat ground fits nearly as
well once it is turned upside down: that is worth a warning.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import SurveyError

# Exchanged axes are believed where they fit this many times better. Up to three locations fit equally well either way.
_TIMES_BETTER = 4.0
_DOWN = -0.8  # cosine between the trajectory's z axis and up


def refuse_exchanged_axes(trajectory: Trajectory, anchors: Anchors, *, scale: bool, gravity: bool) -> None:
    """Refuse a survey that is the mirror image of what the trajectory saw.

    Args:
        scale, gravity: whether the one-time similarity has a scale, and knows which way is up.

    Raises:
        SurveyError: with E and N exchanged the markers fit at least four times better than as given.
    """
    index = anchors.pose_index
    rotation = Rotation.from_quat(trajectory.quat_wxyz[index], scalar_first=True)
    seen_m = trajectory.position_m[index] + rotation.apply(anchors.lever_arm_m)
    given_m, exchanged_m = (
        similarity_rms(seen_m, anchors.surveyed_enh_m[:, axes], scale=scale, gravity=gravity)
        for axes in ([0, 1, 2], [1, 0, 2])
    )
    sigma_m = np.sqrt(np.einsum("kii->k", anchors.lever_covariance_m2 + anchors.survey_covariance_m2).mean())
    if given_m > _TIMES_BETTER * max(exchanged_m, sigma_m):
        raise SurveyError(
            f"the survey's E and N seem to be exchanged: with them swapped the {len(anchors)} visits fit the "
            f"trajectory to {exchanged_m:.3f} m RMS, as given only to {given_m:.3f} m. Check the header of the survey "
            "file, or `columns`. (A left-handed trajectory would look the same, and so may wrong labels, which 'jaxgeo "
            "check' weighs.)"
        )


def upside_down(R_grid_map: Float[np.ndarray, "3 3"]) -> tuple[str, ...]:
    """A warning where the one-time similarity turned the trajectory's z axis down; none for odometry with z forward."""
    if R_grid_map[2, 2] > _DOWN:
        return ()
    return (
        "the trajectory's z axis points down in the grid: either its own frame has z down, or the survey's E and N are "
        "exchanged (check its header, or `columns`; coarse.gravity: true settles it where z is up).",
    )


def similarity_rms(
    source_m: Float[np.ndarray, "k 3"], target_m: Float[np.ndarray, "k 3"], *, scale: bool, gravity: bool
) -> float:
    """RMS distance left by the best similarity, from the singular values of the cross-covariance (Umeyama 1991)."""
    a, b = source_m - source_m.mean(axis=0), target_m - target_m.mean(axis=0)
    cross = b.T @ a
    if gravity:  # a turn about the vertical only
        overlap = np.hypot(cross[0, 0] + cross[1, 1], cross[0, 1] - cross[1, 0]) + cross[2, 2]
    else:
        u, value, vt = np.linalg.svd(cross)
        overlap = value[0] + value[1] + np.sign(np.linalg.det(u) * np.linalg.det(vt)) * value[2]
    a2, b2 = np.sum(a**2), np.sum(b**2)
    factor = max(overlap, 0.0) / max(a2, np.finfo(float).tiny) if scale else 1.0
    return float(np.sqrt(max(b2 - 2.0 * factor * overlap + factor**2 * a2, 0.0) / len(a)))
