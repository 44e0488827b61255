"""Every visit as the others predict it, their noise learned without it; and what shift of it would be seen."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from calibration.faults.evidence import evidences
from calibration.faults.hypotheses import shifted
from calibration.faults.session import Session
from calibration.faults.weigh import labels_of
from jaxgeo.solve.gauge import WEAKEST_TURN_RAD

# With this probability a shift as large as the smallest detectable one is seen.
POWER = 0.95


@dataclasses.dataclass(frozen=True)
class Predicted:
    """One fold a visit asked for; NaN for the others, and where the rest do not fix the frame.

    Attributes:
        tail: (k,) see `Evidence`; `log_rest` (k,) log evidence of the other visits.
        error_m: (k, 3) surveyed minus predicted; `covariance_m2` (k, 3, 3) of it.
        settled: (k,) whether noise and trajectory settled.
    """

    tail: Float[np.ndarray, "k"]
    log_rest: Float[np.ndarray, "k"]
    error_m: Float[np.ndarray, "k 3"]
    covariance_m2: Float[np.ndarray, "k 3 3"]
    settled: Bool[np.ndarray, "k"]

    @property
    def done(self) -> Bool[np.ndarray, "k"]:
        return np.isfinite(self.tail)


def predict(session: Session, visits: Sequence[int]) -> Predicted:
    """Leave one visit out at a time."""
    k = len(session.anchors)
    out = Predicted(
        np.full(k, np.nan), np.full(k, np.nan), np.full((k, 3), np.nan), np.full((k, 3, 3), np.nan), np.zeros(k, bool)
    )
    if not visits:
        return out
    single = shifted(session.told)
    found = evidences(session, [labels_of(session, single[j]) for j in visits])
    for row, j in enumerate(visits):
        point, covariance = found.point_m[row, j], found.error_covariance_m2[row, j]
        if np.isfinite(found.log_marginal[row]) and np.isfinite(point).all() and np.isfinite(covariance).all():
            out.tail[j], out.log_rest[j] = found.tail[row, j], found.log_marginal[row]
            out.error_m[j], out.covariance_m2[j] = session.anchors.surveyed_enh_m[j] - point, covariance
            out.settled[j] = found.settled[row]
    return out


def testable(session: Session, predicted: Predicted) -> Bool[np.ndarray, "k"]:
    """Which visits' predictions bear a test: settled, and turned by less than linearising bears.

    The turn is the prediction's standard deviation over its lever, the distance to the nearest other location; beyond
    `WEAKEST_TURN_RAD` the error lies on an arc, and its tails are not those of chi square.
    """
    point, told = session.anchors.surveyed_enh_m, np.array(session.told)
    out = predicted.done & predicted.settled
    for j in np.flatnonzero(out):
        lever_m = np.linalg.norm(point[told != told[j]] - point[j], axis=1).min()
        out[j] = np.sqrt(np.linalg.eigvalsh(predicted.covariance_m2[j])[-1]) < WEAKEST_TURN_RAD * lever_m
    return out


def smallest_shift_m(predicted: Predicted, alarm: float) -> Float[np.ndarray, "k"]:
    """Smallest detectable shift (Baarda 1968) in the direction in which its visit is known worst; NaN: not predicted.

    The noncentrality with which chi square of three degrees of freedom passes the gate, `alarm` shared among all
    visits, with probability `POWER`; the noise as learned.
    """
    gate = chi2.isf(alarm / len(predicted.tail), 3)
    needed = brentq(lambda x: ncx2.sf(gate, 3, x) - POWER, 1e-3, 1e4)
    out = np.full(len(predicted.tail), np.nan)
    for j in np.flatnonzero(predicted.done):
        out[j] = np.sqrt(needed * np.linalg.eigvalsh(predicted.covariance_m2[j])[-1])
    return out
