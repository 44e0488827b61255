"""Which of a marker's two planar solutions is right: decided by the fit, and by the other sightings of its run.

One view of a square often fits two poses, mirrored about the line of sight. By itself a sighting has the log odds

    (chi2_2 - chi2_1) / (2 s^2),    s^2 = max(1, chi2_1 / 2),

of the first over the second: chi2 is scaled by the better one's misfit over its expectation (two degrees of freedom),
so that a sigma given too small does not make a choice look certain. Two solutions that met at one minimum are one
solution. (The ratio of the covariances' determinants, which a flat prior on poses would add, hardly matters for a
right sigma, and for one given too large it outvotes the pixels: left out.)

Along a run the right solution moves as the body does; a jump to the mirror turns the marker by twice its tilt at once,
faster than any body turns. So each marker's sightings are a hidden Markov chain with two states a sighting:

- a state's log likelihood is its sighting's own. Sightings of one camera within `independent_s` share their errors
  (distortion, print): each counts as its part of one.
- a pair of neighbours costs d^T S^-1 d / 2, d the rotation between the two poses of the marker in the body, less as
  much of it as the body may have turned meanwhile, S the sum of both rotations' covariances and a floor. A turning
  body and long gaps cost nothing. No pair costs more than `outlier` allows.

Where the mirror moves as smoothly as the truth (a body that hardly moves) both chains stay likely, and the sightings
stay ambiguous. Viterbi's chain is the choice, forward-backward odds are the doubt that is left: Rabiner, "A tutorial on
hidden Markov models", Proc. IEEE 77(2), 1989. The doubt goes into the covariance: about the chosen solution 1,

    (1 - w) C_1 + w (C_2 + d d^T),    w = 1 / (1 + odds),

with d from the chosen solution to the other: the second moment of the error, whichever of them is right.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxgeo.associate.square_pair import SquarePairs
from jaxgeo.associate.two_state_chain import two_state_chain

_SURE = 1e3  # log odds where there is no second solution
_SAME = 1e-2  # squared Mahalanobis distance below which two refined solutions are one minimum


@dataclasses.dataclass(frozen=True)
class AmbiguityRule:
    """What the choice within a run assumes.

    Attributes:
        turn_rate_rad_s: the fastest that the body turns.
        floor_rad: per axis, what stamps and calibration add to a rotation between two sightings.
        independent_s: sightings of one camera closer in time than this count as one.
        outlier: probability that a sighting's rotation is neither of its solutions (a moved marker, a false id).
    """

    turn_rate_rad_s: float = 2.0
    floor_rad: float = 0.02
    independent_s: float = 0.5
    outlier: float = 0.01


@dataclasses.dataclass(frozen=True)
class Choice:
    """What was decided for each sighting.

    Attributes:
        single: (n,) whether there is one solution only.
        second: (n,) whether its run prefers the second solution.
        log_odds: (n,) of the first solution over the second, after the run.
    """

    single: Bool[np.ndarray, "n"]
    second: Bool[np.ndarray, "n"]
    log_odds: Float[np.ndarray, "n"]


def choose_by_run(
    stamp_s: Float[np.ndarray, "n"],
    marker: np.ndarray,
    camera: np.ndarray,
    pairs: SquarePairs,
    rule: AmbiguityRule,
) -> Choice:
    """The likelier solution of every sighting, given all sightings of its marker.

    Args:
        stamp_s: need not be sorted.
        marker, camera: (n,) names. Sightings without an id may be of several markers: each decides for itself.
        pairs: both solutions; the first of each is finite.
    """
    single = ~np.all(np.isfinite(pairs.covariance[:, 1]), axis=(1, 2)) | np.isnan(pairs.fit[:, 1])
    single[~single] = _one_minimum(pairs.take(~single))
    alone = _log_odds_alone(pairs, single)
    choice = Choice(single=single, second=np.zeros(len(stamp_s), dtype=bool), log_odds=alone.copy())
    for name in np.unique(marker):
        rows = np.flatnonzero(marker == name)
        if str(name) == "" or rows.size < 2 or single[rows].all():
            continue
        rows = rows[np.argsort(stamp_s[rows], kind="stable")]
        state = np.zeros((len(rows), 2))
        state[:, 1] = -alone[rows] * _share(stamp_s[rows], camera[rows], rule.independent_s)
        path, posterior = two_state_chain(state, _pair_log_likelihood(stamp_s[rows], pairs, rows, rule))
        choice.second[rows] = (path == 1) & ~single[rows]
        after = np.clip(posterior[:, 0] - posterior[:, 1], -_SURE, _SURE)
        # Counting as a part of one must not make a sighting doubt what its run confirms.
        confirmed = np.where(after > 0.0, np.maximum(after, alone[rows]), after)
        choice.log_odds[rows] = np.where(single[rows], _SURE, confirmed)
    return choice


def doubted_covariance(pairs: SquarePairs, chosen: np.ndarray, choice: Choice) -> Float[np.ndarray, "n 6 6"]:
    """Covariance about the chosen solution (0 or 1 a row), with the chance that the other one is right."""
    row = np.arange(len(chosen))
    covariance = pairs.covariance[row, chosen].copy()
    log_odds = np.where(chosen == 1, -choice.log_odds, choice.log_odds)
    weight = np.where(choice.single, 0.0, 1.0 / (1.0 + np.exp(np.clip(log_odds, -50.0, 50.0))))
    open_ = weight > 1e-12
    difference = _difference(pairs.take(open_), chosen[open_])
    spread = pairs.covariance[row, 1 - chosen][open_] + difference[:, :, None] * difference[:, None, :]
    share = weight[open_, None, None]
    covariance[open_] = (1.0 - share) * covariance[open_] + share * spread
    return covariance


def _log_odds_alone(pairs: SquarePairs, single: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    chi2 = 8.0 * pairs.fit[~single] ** 2
    log_odds = np.full(len(single), _SURE)
    misfit = np.maximum(chi2[:, 0] / 2.0, 1.0)
    log_odds[~single] = (chi2[:, 1] - chi2[:, 0]) / (2.0 * misfit)
    return np.minimum(log_odds, _SURE)


def _one_minimum(pairs: SquarePairs) -> Bool[np.ndarray, "m"]:
    d = _difference(pairs, np.zeros(len(pairs.fit), dtype=np.int64))
    return np.einsum("ni,ni->n", d, np.linalg.solve(pairs.covariance[:, 0], d[:, :, None])[:, :, 0]) < _SAME


def _difference(pairs: SquarePairs, chosen: np.ndarray) -> Float[np.ndarray, "n 6"]:
    """From the chosen solution to the other: translation added, rotation multiplied on the left."""
    row = np.arange(len(chosen))
    if row.size == 0:
        return np.zeros((0, 6))
    turn = pairs.R_body_marker[row, 1 - chosen] @ np.swapaxes(pairs.R_body_marker[row, chosen], 1, 2)
    moved = pairs.t_body_marker_m[row, 1 - chosen] - pairs.t_body_marker_m[row, chosen]
    return np.concatenate([moved, Rotation.from_matrix(turn).as_rotvec()], axis=1)


def _share(stamp_s: Float[np.ndarray, "n"], camera: np.ndarray, independent_s: float) -> Float[np.ndarray, "n"]:
    """One over the number of sightings by the same camera within `independent_s` (half before, half after)."""
    share = np.ones(len(stamp_s))
    for name in np.unique(camera):
        rows = np.flatnonzero(camera == name)
        near = [np.searchsorted(stamp_s[rows], stamp_s[rows] + side * independent_s / 2.0) for side in (-1.0, 1.0)]
        share[rows] = 1.0 / np.maximum(near[1] - near[0], 1)
    return share


def _pair_log_likelihood(
    stamp_s: Float[np.ndarray, "n"], pairs: SquarePairs, rows: np.ndarray, rule: AmbiguityRule
) -> Float[np.ndarray, "m 2 2"]:
    """Of the four pairings of each sighting's solutions with the next one's: (n - 1, 2, 2), at most 0."""
    R, spread = pairs.R_body_marker[rows], pairs.covariance[rows][:, :, 3:, 3:]
    known = np.all(np.isfinite(R), axis=(2, 3)) & np.all(np.isfinite(spread), axis=(2, 3))
    R = np.where(known[:, :, None, None], R, np.eye(3))
    spread = np.where(known[:, :, None, None], spread, np.eye(3))
    turn = np.einsum("mjab,micb->mijac", R[1:], R[:-1])
    d = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 2, 2, 3)
    angle = np.linalg.norm(d, axis=3)
    allowed = rule.turn_rate_rad_s * np.diff(stamp_s)[:, None, None]
    d = d * np.maximum(1.0 - allowed / np.maximum(angle, 1e-12), 0.0)[..., None]
    S = spread[:-1, :, None] + spread[1:, None] + rule.floor_rad**2 * np.eye(3)
    distance2 = np.einsum("mijk,mijk->mij", d, np.linalg.solve(S, d[..., None])[..., 0])
    return np.logaddexp(np.log1p(-rule.outlier) - distance2 / 2.0, np.log(rule.outlier))
