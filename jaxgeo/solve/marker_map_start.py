"""Where a marker map starts: a spanning tree over markers seen together, then flips settled by what all images say.

A square seen by a camera has two poses (IPPE). Of the up to four relative poses of two markers in one image, the right
one is the same in every image; the wrong ones are not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_POSE_SCALE_RAD = 0.2  # two relative poses further apart than this (and as much of their distance) do not agree
_ROUNDS = 20
_WORST_PX = 20.0  # no corner argues for or against a pose with more than this


class Poses(NamedTuple):
    """Rotations and positions of frames in one frame."""

    R: Float[np.ndarray, "n 3 3"]
    t: Float[np.ndarray, "n 3"]


class Candidates(NamedTuple):
    """Both poses T_body_marker of every sighting, and what predicts its corners.

    Attributes:
        R, t: poses; NaN where there is none.
        error_px: RMS of each.
        image, marker: rows of the sighting.
        normalised: undistorted corners (x/z, y/z) in the sighting's camera.
        focal_px: pixels in one unit of them.
        corners_m: corners in the marker's frame.
        R_cam_body, t_cam_body_m: the sighting's camera.
    """

    R: Float[np.ndarray, "s 2 3 3"]
    t: Float[np.ndarray, "s 2 3"]
    error_px: Float[np.ndarray, "s 2"]
    image: Int[np.ndarray, "s"]
    marker: Int[np.ndarray, "s"]
    normalised: Float[np.ndarray, "s 4 2"]
    focal_px: Float[np.ndarray, "s"]
    corners_m: Float[np.ndarray, "s 4 3"]
    R_cam_body: Float[np.ndarray, "s 3 3"]
    t_cam_body_m: Float[np.ndarray, "s 3"]


def groups_seen_together(
    image: Int[np.ndarray, "s"], marker: Int[np.ndarray, "s"], n_markers: int
) -> list[Int[np.ndarray, "g"]]:
    """Markers in groups linked by images that show two of them, the largest first."""
    group = np.arange(n_markers)
    for rows in rows_by(image):
        linked = np.isin(group, group[marker[rows]])
        group[linked] = group[linked].min() if linked.any() else 0
    found = [np.flatnonzero(group == name) for name in np.unique(group)]
    return sorted(found, key=len, reverse=True)


def starting_poses(candidates: Candidates, n_images: int, n_markers: int, origin: int) -> tuple[Poses, Poses]:
    """Poses T_map_body of images and T_map_marker of markers, `origin` at the identity.

    All markers must be linked (`groups_seen_together`).
    """
    markers = _along_tree(_edges(candidates), n_markers, origin)
    images = Poses(np.tile(np.eye(3), (n_images, 1, 1)), np.zeros((n_images, 3)))
    return _settled(candidates, images, markers, origin)


def _settled(candidates: Candidates, images: Poses, markers: Poses, origin: int) -> tuple[Poses, Poses]:
    """Image by image and marker by marker, the pose among all that single sightings propose which fits best.

    The fit is the sum over the sightings of the mean squared reprojection error, each at most 20 px. Repeated until
    nothing changes; a pose is replaced only by one that fits better.
    """
    images = Poses(images.R.copy(), images.t.copy())
    markers = Poses(markers.R.copy(), markers.t.copy())
    for turn in range(_ROUNDS):
        changed = False
        for image, rows in zip(np.unique(candidates.image), rows_by(candidates.image), strict=True):
            changed |= _improve_image(candidates, images, markers, int(image), rows, keep=turn > 0)
        for marker, rows in zip(np.unique(candidates.marker), rows_by(candidates.marker), strict=True):
            if marker != origin:
                changed |= _improve_marker(candidates, images, markers, int(marker), rows)
        if not changed:
            break
    return images, markers


def sighting_error_px(
    candidates: Candidates, rows: Int[np.ndarray, "r"], body: Poses, marker: Poses
) -> Float[np.ndarray, "*b r"]:
    """Root mean squared error of the sightings' corners, focal lengths times normalised coordinates, 20 px at most.

    The two poses have a row for each sighting, and may have leading axes.
    """
    corners = candidates.corners_m[rows]
    points = corners @ np.swapaxes(marker.R, -1, -2) + marker.t[..., None, :]
    in_body = (points - body.t[..., None, :]) @ body.R
    in_cam = in_body @ np.swapaxes(candidates.R_cam_body[rows], -1, -2) + candidates.t_cam_body_m[rows][:, None]
    ahead = np.all(in_cam[..., 2] > 1e-6, axis=-1) & np.all(np.isfinite(in_cam), axis=(-1, -2))
    in_cam = np.where(ahead[..., None, None], in_cam, 1.0)
    off = in_cam[..., :2] / in_cam[..., 2:] - candidates.normalised[rows]
    error = candidates.focal_px[rows] * np.sqrt(np.mean(off**2, axis=(-1, -2)))
    return np.where(ahead, np.minimum(error, _WORST_PX), _WORST_PX)


def _improve_image(
    c: Candidates, images: Poses, markers: Poses, image: int, rows: Int[np.ndarray, "r"], keep: bool
) -> bool:
    own = Poses(markers.R[c.marker[rows]], markers.t[c.marker[rows]])
    usable = np.all(np.isfinite(c.t[rows]), axis=-1)
    # T_map_body = T_map_marker T_body_marker^-1
    R = own.R[:, None] @ np.swapaxes(c.R[rows], -1, -2)
    t = own.t[:, None] - (R @ c.t[rows][..., None])[..., 0]
    proposals = Poses(R[usable], t[usable])
    if keep:
        proposals = _with(proposals, images, image)
    body = Poses(proposals.R[:, None], proposals.t[:, None])
    return _take_best(sighting_error_px(c, rows, body, own), proposals, images, image, keep)


def _improve_marker(c: Candidates, images: Poses, markers: Poses, marker: int, rows: Int[np.ndarray, "r"]) -> bool:
    body = Poses(images.R[c.image[rows]], images.t[c.image[rows]])
    usable = np.all(np.isfinite(c.t[rows]), axis=-1)
    R = body.R[:, None] @ c.R[rows]
    t = body.t[:, None] + (body.R[:, None] @ c.t[rows][..., None])[..., 0]
    proposals = _with(Poses(R[usable], t[usable]), markers, marker)
    own = Poses(proposals.R[:, None], proposals.t[:, None])
    return _take_best(sighting_error_px(c, rows, body, own), proposals, markers, marker, True)


def _with(proposals: Poses, poses: Poses, row: int) -> Poses:
    """The present pose first."""
    return Poses(np.concatenate([poses.R[row][None], proposals.R]), np.concatenate([poses.t[row][None], proposals.t]))


def _take_best(error_px: Float[np.ndarray, "p r"], proposals: Poses, poses: Poses, row: int, keep: bool) -> bool:
    fit = np.sum(error_px**2, axis=1)
    best = int(np.argmin(fit))
    if keep and (best == 0 or fit[best] > fit[0] * (1.0 - 1e-6)):
        return False
    poses.R[row], poses.t[row] = proposals.R[best], proposals.t[best]
    return True


class _Edge(NamedTuple):
    """Relative pose T_a_b of two markers, and how badly the images agree on it (0 to 1)."""

    a: int
    b: int
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    doubt: float


def _edges(c: Candidates) -> list[_Edge]:
    pairs: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for rows in rows_by(c.image):
        for first in rows.tolist():
            for second in rows.tolist():
                if c.marker[first] < c.marker[second]:
                    pair = (int(c.marker[first]), int(c.marker[second]))
                    pairs.setdefault(pair, []).append((first, second))
    return [_agreed(c, pair, seen) for pair, seen in pairs.items()]


def _agreed(c: Candidates, pair: tuple[int, int], seen: Sequence[tuple[int, int]]) -> _Edge:
    """Of all relative poses of all images, the one that the images agree on best; a badly fitting one counts less."""
    first, second = np.array(seen).T
    a, b = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    back = np.swapaxes(c.R[first][:, a], -1, -2)
    R = back @ c.R[second][:, b]
    t = (back @ (c.t[second][:, b] - c.t[first][:, a])[..., None])[..., 0]
    n = len(seen)
    flat_R, flat_t = R.reshape(-1, 3, 3), t.reshape(-1, 3)
    cosine = 0.5 * (np.einsum("pij,qij->pq", flat_R, flat_R) - 1.0)
    angle = np.arccos(np.clip(np.nan_to_num(cosine, nan=-1.0), -1.0, 1.0))
    gap = np.linalg.norm(flat_t[:, None] - flat_t[None], axis=2) / np.linalg.norm(flat_t, axis=1)[:, None]
    apart = np.minimum(np.nan_to_num(np.hypot(angle, gap), nan=9.0) / _POSE_SCALE_RAD, 1.0)
    nearest = apart.reshape(4 * n, n, 4).min(axis=2).mean(axis=1)
    error = np.maximum(c.error_px[first][:, a], c.error_px[second][:, b]).reshape(-1)
    doubt = nearest + 0.2 * np.minimum(np.nan_to_num(error, nan=_WORST_PX) / _WORST_PX, 1.0)
    doubt = np.where(np.all(np.isfinite(flat_t), axis=1), doubt, np.inf)
    best = int(np.argmin(doubt))
    # One image agrees with itself: pairs seen often go first.
    return _Edge(*pair, flat_R[best], flat_t[best], float(doubt[best]) + 1.0 / n)


def _along_tree(edges: Sequence[_Edge], n_markers: int, origin: int) -> Poses:
    """Prim's tree from the origin, the least doubtful link first."""
    R, t = np.tile(np.eye(3), (n_markers, 1, 1)), np.zeros((n_markers, 3))
    placed = np.arange(n_markers) == origin
    waiting = sorted((edge for edge in edges if np.isfinite(edge.doubt)), key=lambda edge: edge.doubt)
    while not placed.all():
        edge = next((edge for edge in waiting if placed[edge.a] != placed[edge.b]), None)
        if edge is None:
            break  # a marker whose every sighting has no pose: it stays at the origin, `settled` has no proposal for it
        if placed[edge.a]:
            R[edge.b], t[edge.b] = R[edge.a] @ edge.R, t[edge.a] + R[edge.a] @ edge.t
        else:
            R[edge.a] = R[edge.b] @ edge.R.T
            t[edge.a] = t[edge.b] - R[edge.a] @ edge.t
        placed[[edge.a, edge.b]] = True
    return Poses(R, t)


def rows_by(label: Int[np.ndarray, "s"]) -> list[Int[np.ndarray, "r"]]:
    """Rows of each distinct label, labels ascending."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
