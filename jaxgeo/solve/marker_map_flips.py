"""Poses to try again once a map is solved: the other planar solution of a marker or an image, where it fits nearly.

A pose in the wrong one of its two minima stays there: the joint solve has bent everything around it, so that no other
pose fits better as it is. Whether the other one is right shows only after a joint solve that starts from it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxgeo.solve.marker_map_start import Candidates, Poses, rows_by, sighting_error_px

_DIFFERENT_RAD = 0.25  # nearer poses lead to the same minimum
_WORST_RMS_PX = 8.0  # a pose that one sighting proposes is a few pixels off in the others; what is further off is wrong


class Flip(NamedTuple):
    """Another pose for an image or a marker, and the RMS error of its sightings at it as it is."""

    of_image: bool
    row: int
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    error_px: float


def flips(c: Candidates, images: Poses, markers: Poses, origin: int) -> list[Flip]:
    """For each image and marker the best pose in another minimum, if one fits nearly; the likeliest first."""
    found = [_image_flip(c, images, markers, int(c.image[rows[0]]), rows) for rows in rows_by(c.image)]
    found += [
        _marker_flip(c, images, markers, int(c.marker[rows[0]]), rows)
        for rows in rows_by(c.marker)
        if c.marker[rows[0]] != origin
    ]
    return sorted((flip for flip in found if flip is not None), key=lambda flip: flip.error_px)


def flipped(flip: Flip, images: Poses, markers: Poses) -> tuple[Poses, Poses]:
    """The poses with one replaced."""
    images, markers = Poses(images.R.copy(), images.t.copy()), Poses(markers.R.copy(), markers.t.copy())
    poses = images if flip.of_image else markers
    poses.R[flip.row], poses.t[flip.row] = flip.R, flip.t
    return images, markers


def _image_flip(c: Candidates, images: Poses, markers: Poses, image: int, rows: Int[np.ndarray, "r"]) -> Flip | None:
    own = Poses(markers.R[c.marker[rows]], markers.t[c.marker[rows]])
    R = own.R[:, None] @ np.swapaxes(c.R[rows], -1, -2)
    t = own.t[:, None] - (R @ c.t[rows][..., None])[..., 0]
    proposals = _different(R, t, images.R[image])
    error_px = sighting_error_px(c, rows, Poses(proposals.R[:, None], proposals.t[:, None]), own)
    return _best(proposals, error_px, True, image)


def _marker_flip(c: Candidates, images: Poses, markers: Poses, marker: int, rows: Int[np.ndarray, "r"]) -> Flip | None:
    body = Poses(images.R[c.image[rows]], images.t[c.image[rows]])
    R = body.R[:, None] @ c.R[rows]
    t = body.t[:, None] + (body.R[:, None] @ c.t[rows][..., None])[..., 0]
    proposals = _different(R, t, markers.R[marker])
    error_px = sighting_error_px(c, rows, body, Poses(proposals.R[:, None], proposals.t[:, None]))
    return _best(proposals, error_px, False, marker)


def _different(R: Float[np.ndarray, "r 2 3 3"], t: Float[np.ndarray, "r 2 3"], present: np.ndarray) -> Poses:
    """The proposals that are turned from the present pose by more than one minimum's width."""
    R, t = R.reshape(-1, 3, 3), t.reshape(-1, 3)
    usable = np.all(np.isfinite(t), axis=1) & np.all(np.isfinite(R), axis=(1, 2))
    cosine = 0.5 * (np.einsum("pij,ij->p", np.where(usable[:, None, None], R, 0.0), present) - 1.0)
    usable &= cosine < np.cos(_DIFFERENT_RAD)
    return Poses(R[usable], t[usable])


def _best(proposals: Poses, error_px: Float[np.ndarray, "p r"], of_image: bool, row: int) -> Flip | None:
    rms_px = np.sqrt(np.mean(error_px**2, axis=1))
    if rms_px.size == 0 or rms_px.min() > _WORST_RMS_PX:
        return None
    best = int(np.argmin(rms_px))
    return Flip(of_image, row, proposals.R[best], proposals.t[best], float(rms_px[best]))
