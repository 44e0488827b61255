"""Sightings that are pushed, checked before anything is kept of them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxgeo.data import Sightings
from jaxgeo.errors import SightingError

_NORM_MARGIN = 1e-3


def one_sighting(
    stamp_s: float,
    marker: str,
    t_body_marker_m: Sequence[float],
    covariance: Float[np.ndarray, "3 3"] | Float[np.ndarray, "6 6"],
    quat_body_marker_wxyz: Sequence[float] | None,
    ambiguous: bool,
) -> Sightings:
    """A single sighting as a table of one row.

    Raises:
        SightingError: numbers of the wrong shape.
    """
    try:
        place = np.asarray(t_body_marker_m, dtype=np.float64)
        given = np.asarray(covariance, dtype=np.float64)
        quat = np.full(4, np.nan) if quat_body_marker_wxyz is None else np.asarray(quat_body_marker_wxyz, np.float64)
        stamp = float(stamp_s)
    except (TypeError, ValueError) as failure:
        raise SightingError(f"sighting of marker {marker!r}: {failure}; expected numbers.") from None
    if place.shape != (3,) or quat.shape != (4,) or given.shape not in ((3, 3), (6, 6)):
        raise SightingError(
            f"sighting of marker {marker!r} at {stamp:.6f} s: position of shape {place.shape}, quaternion of "
            f"{quat.shape}, covariance of {given.shape}; expected (3,), (4,) and (3, 3) or (6, 6)."
        )
    full = np.zeros((6, 6))
    full[: len(given), : len(given)] = given
    return Sightings(
        stamp_s=np.array([stamp]),
        marker=np.array([marker]),
        t_body_marker_m=place[None],
        quat_body_marker_wxyz=quat[None],
        covariance=full[None],
        ambiguous=np.array([ambiguous]),
        reprojection_px=np.array([np.nan]),
        source=np.array([f"sighting at {stamp:.3f} s"]),
    )


def check_sightings(sightings: Sightings, *, by_order: bool) -> None:
    """Refuse what cannot be used, the first bad row named.

    Raises:
        SightingError: a stamp or position that is not finite, a covariance that is not positive definite, a rotation
            that is none, or no id where visits are told apart by it.
    """
    if len(sightings) == 0:
        return
    position, quat = sightings.t_body_marker_m, sightings.quat_body_marker_wxyz
    norm = np.linalg.norm(quat, axis=1)
    covariance = sightings.covariance
    finite = np.isfinite(sightings.stamp_s) & np.all(np.isfinite(position), axis=1)
    known = np.all(np.isfinite(covariance), axis=(1, 2))
    # Where it is not finite, a matrix without a positive eigenvalue stands in.
    least = np.linalg.eigvalsh(np.where(known.reshape(-1, 1, 1), covariance[:, :3, :3], 0.0))[:, 0]
    for bad, what in (
        (~finite, "stamp or position is not finite. Drop it"),
        (~(least > 0.0), "position covariance is not positive definite. Give it a standard deviation above zero"),
        (
            ~(np.all(np.isnan(quat), axis=1) | (np.abs(norm - 1.0) <= _NORM_MARGIN)),
            "quaternion is not of norm 1. Normalise it (w, x, y, z), or give none where only the position is known",
        ),
        (
            (sightings.marker == "") & (not by_order),
            "marker has no id. Give the order in which the locations are visited",
        ),
    ):
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise SightingError(
                f"{sightings.source[row]}: sighting of marker {str(sightings.marker[row])!r} at stamp "
                f"{sightings.stamp_s[row]:.6f} s, position {position[row].tolist()}: its {what}. "
                f"None of the {len(sightings)} sightings pushed with it was kept."
            )
