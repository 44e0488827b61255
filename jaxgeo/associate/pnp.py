"""Marker corners to marker poses in the body frame, with covariance: PnP for all sightings at once."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxgeo.associate.ambiguity import AmbiguityRule, choose_by_run, doubted_covariance
from jaxgeo.associate.camera_model import check_camera
from jaxgeo.associate.refinement import refine
from jaxgeo.associate.square_pair import SquarePairs, square_pairs
from jaxgeo.data import CornerSightings, Rig, Sightings
from jaxgeo.errors import SightingError

__all__ = ["corners_to_sightings", "refine"]

# Eight pixel coordinates less six unknowns: the RMS residual expected of a right solution is sigma * sqrt(2 / 8).
_EXPECTED_FIT = 0.5


def corners_to_sightings(
    corners: CornerSightings,
    rig: Rig,
    marker_size_m: float | dict[str, float],
    pixel_sigma_px: float,
    *,
    ambiguity_ratio: float = 2.0,
    worst_fit: float = 5.0,
    ambiguity_rule: AmbiguityRule | None = None,
) -> tuple[Sightings, tuple[str, ...]]:
    """Poses `T_body_marker` of square markers from their four corners.

    Both planar solutions (IPPE) are refined on the distorted pixels and the one with the smaller error is kept.
    The covariance is pixel_sigma^2 (J^T J)^-1 of the reprojection Jacobian J: random corner noise only, local to the
    kept solution. Where the corners carry a covariance C of their own, r^T C^-1 r is minimised instead and the
    covariance is (J^T C^-1 J)^-1; everything below said in pixel sigmas is then in standard deviations of C.

    Args:
        marker_size_m: side length, one for all, or by marker id with an optional entry "default".
        pixel_sigma_px: standard deviation of each corner coordinate.
        ambiguity_ratio: a sighting is ambiguous where RMS2 < ratio * max(RMS1, sigma / 2). The floor is the RMS
            that corner noise alone leaves (eight coordinates, six unknowns), so that a lucky fit does not look
            unique. With the default 2 and pure noise the flag means chi2_2 - chi2_1 below about 6: odds of the
            kept solution under 20 to 1.
        worst_fit: corners whose RMS error exceeds this many pixel sigmas are not of one square.
        ambiguity_rule: with it, ambiguous sightings choose between their two solutions by the other sightings of their
            marker, are no longer ambiguous where those leave odds above exp(ratio^2 - 1) (20 to 1 for the ratio 2),
            and every covariance holds the chance that the other solution is the right one: see `ambiguity`. Default:
            each sighting for itself, by its fit alone.

    Returns:
        the sightings, in the order given, and warnings: corners outside the image or the camera model's range, that
        no marker in front of the camera explains, or that fit worse than `worst_fit` are left out and counted there.

    Raises:
        SightingError: a camera that is not in the rig, a marker without a size, a size or sigma that is not positive,
            corners that are not numbers, no usable sighting at all.
    """
    size_m = _sizes(corners, marker_size_m)
    _check(corners, rig, pixel_sigma_px)
    whitening = _whitening(corners, pixel_sigma_px)
    pairs = square_pairs(corners, rig, size_m, pixel_sigma_px, whitening)
    solved = np.isfinite(pairs.fit[:, 0]) & np.all(np.isfinite(pairs.covariance[:, 0]), axis=(1, 2))
    kept = solved & (pairs.fit[:, 0] <= worst_fit)
    warnings = _refusals(
        corners,
        {
            "have corners outside the image or the range of the camera's distortion model": ~pairs.in_range,
            "have corners that no marker in front of the camera explains (degenerate or behind it)": pairs.in_range
            & ~solved,
            f"fit a square worse than {worst_fit:g} times {_unit_words(whitening, pixel_sigma_px)}": solved & ~kept,
        },
    )
    chosen, ambiguous, covariance = _choose(corners, pairs, kept, ambiguity_ratio, worst_fit, ambiguity_rule)
    row = np.arange(len(corners))
    quaternion = np.full((len(corners), 4), np.nan)
    quaternion[kept] = Rotation.from_matrix(pairs.R_body_marker[row, chosen][kept]).as_quat(scalar_first=True)
    sightings = Sightings(
        stamp_s=corners.stamp_s,
        marker=corners.marker,
        t_body_marker_m=pairs.t_body_marker_m[row, chosen],
        quat_body_marker_wxyz=quaternion,
        covariance=covariance,
        ambiguous=ambiguous,
        reprojection_px=pairs.reprojection_px[row, chosen],
        source=corners.source,
    )
    return sightings if kept.all() else sightings.take(np.flatnonzero(kept)), warnings


def _choose(
    corners: CornerSightings,
    pairs: SquarePairs,
    kept: Bool[np.ndarray, "n"],
    ambiguity_ratio: float,
    worst_fit: float,
    rule: AmbiguityRule | None,
) -> tuple[Int[np.ndarray, "n"], Bool[np.ndarray, "n"], Float[np.ndarray, "n 6 6"]]:
    """Which solution of each kept row holds (0, 1), whether that is ambiguous, and the covariance about it."""
    second = np.where(np.isnan(pairs.fit[:, 1]), np.inf, pairs.fit[:, 1])
    ambiguous = second < ambiguity_ratio * np.maximum(pairs.fit[:, 0], _EXPECTED_FIT)
    chosen = np.zeros(len(corners), dtype=np.int64)
    covariance = pairs.covariance[:, 0].copy()
    if rule is None or not kept.any():
        return chosen, ambiguous, covariance
    rows = np.flatnonzero(kept)
    pairs = pairs.take(rows)
    choice = choose_by_run(corners.stamp_s[rows], corners.marker[rows], corners.camera[rows], pairs, rule)
    # A sighting that is clear by itself is not overruled: that its neighbours disagree is more likely their mistake.
    swapped = choice.second & ambiguous[rows] & (second[rows] <= worst_fit)
    chosen[rows] = swapped
    log_odds = np.where(swapped, -choice.log_odds, choice.log_odds)
    ambiguous[rows] &= ~choice.single & (log_odds <= ambiguity_ratio**2 - 1.0)
    covariance[rows] = doubted_covariance(pairs, chosen[rows], choice)
    return chosen, ambiguous, covariance


def _whitening(corners: CornerSightings, pixel_sigma_px: float) -> Float[np.ndarray, "n 8 8"] | None:
    """W with W^T W = C^-1 for each sighting (pixel_sigma where it has no covariance); None where none has one."""
    if corners.covariance_px2 is None:
        return None
    known = np.all(np.isfinite(corners.covariance_px2), axis=(1, 2))
    if not known.any():
        return None
    covariance = np.where(known[:, None, None], corners.covariance_px2, pixel_sigma_px**2 * np.eye(8))
    try:
        return np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        bad = int(np.argmin(np.linalg.eigvalsh(covariance)[:, 0]))
        raise SightingError(
            f"{corners.source[bad]}: the covariance of its corners is not positive definite; expected (8, 8), pixels "
            "squared."
        ) from None


def _unit_words(whiten: Float[np.ndarray, "n 8 8"] | None, pixel_sigma_px: float) -> str:
    return f"pixel_sigma_px = {pixel_sigma_px:g} px" if whiten is None else "the corners' own standard deviations"


def _sizes(corners: CornerSightings, marker_size_m: float | dict[str, float]) -> Float[np.ndarray, "n"]:
    by_id = marker_size_m if isinstance(marker_size_m, dict) else {"default": marker_size_m}
    for marker, size in by_id.items():
        if not (np.isfinite(size) and size > 0.0):
            raise SightingError(
                f"marker size of '{marker}' is {size} m; expected the side length, above zero, in metres."
            )
    ids = [str(marker) for marker in corners.marker]
    missing = sorted({marker for marker in ids if marker not in by_id}) if "default" not in by_id else []
    if missing:
        raise SightingError(
            f"no marker size for id {', '.join(repr(m) for m in missing[:10])} (of {len(missing)} without one); "
            f"sizes are given for {', '.join(sorted(by_id)) or 'none'}. Add them, or an entry 'default'."
        )
    return np.array([by_id.get(marker, by_id.get("default", np.nan)) for marker in ids], dtype=np.float64)


def _check(corners: CornerSightings, rig: Rig, pixel_sigma_px: float) -> None:
    if not (np.isfinite(pixel_sigma_px) and pixel_sigma_px > 0.0):
        raise SightingError(f"pixel_sigma_px is {pixel_sigma_px}; expected a standard deviation above zero, in pixels.")
    if len(corners) == 0:
        raise SightingError("there are no marker corners to make sightings of.")
    for name in np.unique(corners.camera):
        if str(name) not in rig.cameras:
            first = corners.source[np.flatnonzero(corners.camera == name)[0]]
            raise SightingError(
                f"{first}: camera '{name}' is not in the rig, which has {', '.join(rig.cameras) or 'no cameras'}. "
                "Name it there, or map the file's name to a rig camera with `camera_names`."
            )
        check_camera(str(name), rig.cameras[str(name)])
    bad = np.flatnonzero(~np.all(np.isfinite(corners.corners_px), axis=(1, 2)))
    if bad.size:
        raise SightingError(f"{corners.source[bad[0]]}: marker corners are not finite numbers ({bad.size} such rows).")


def _refusals(corners: CornerSightings, kinds: dict[str, Bool[np.ndarray, "n"]]) -> tuple[str, ...]:
    """One sentence for each kind of row left out; an error where no row is left."""
    sentences = []
    for what, refused in kinds.items():
        rows = np.flatnonzero(refused)
        if rows.size:
            named = ", ".join(str(corners.source[row]) for row in rows[:3]) + " ..." * (rows.size > 3)
            sentences.append(f"{rows.size} of {len(corners)} sightings {what} and are left out: {named}.")
    if sum(np.count_nonzero(refused) for refused in kinds.values()) == len(corners):
        raise SightingError(
            " ".join(sentences) + " None is left: check intrinsics, distortion model, corner order and pixel_sigma_px."
        )
    return tuple(sentences)
