"""Is the whole search worth its seconds? Closed-form leave-one-out residuals, and the quick order of label faults.

With P the projector of `small_system` and c the misclosures, leaving visit j out gives without a new solve

    e_j = P_jj^-1 (P c)_j      of covariance      P_jj^-1

in whitened metres, and the level of the drift is weighed by what the other visits say of it.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from calibration.faults import hypotheses as of
from calibration.faults.screen import laid_onto, screen
from calibration.faults.session import Session
from calibration.faults.small_system import FACTORS, SmallSystem, small_system

# Wide on purpose: the search decides. Alarms on right labels are as many as this only where the noise has the prior's
# ratios; and a label fault is looked into unless its closed form lies so many nats below the labels as told.
TAIL, NATS = 0.2, 5.0


@dataclasses.dataclass(frozen=True)
class Gate:
    """What closed forms say.

    Attributes:
        tail: (k,) probability of every visit's leave-one-out residual being as large as it is; NaN: cannot be left out.
        log_ratio: of the likeliest label fault over the labels as told.
        worth: whether the search should run.
    """

    tail: Float[np.ndarray, "k"]
    log_ratio: float

    @property
    def worth(self) -> bool:
        smallest = np.nanmin(self.tail, initial=1.0)
        return bool(smallest * len(self.tail) < TAIL or self.log_ratio > -NATS)


def gate(session: Session, *, ordered: bool) -> Gate:
    """One small system, no learning."""
    faults = of.mislabelled(session.told, session.site.name) + of.exchanged(session.told)
    faults += of.slipped(session.told) if ordered else []
    quick = screen(session, [of.right(session.told), *faults])
    log_ratio = float(quick[1:].max(initial=-np.inf) - quick[0])
    return Gate(leave_one_out_tails(small_system(session), session.anchors.surveyed_enh_m), log_ratio)


def leave_one_out_tails(system: SmallSystem, surveyed_m: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k"]:
    """Chi-square tail of every visit's leave-one-out residual, the drift's level as the other visits tell it."""
    k = len(surveyed_m)
    c = system.whitened(system.point_m - laid_onto(surveyed_m, system.point_m, np.ones(k, dtype=bool)))
    tail, log_rest = np.full((len(FACTORS), k), np.nan), np.full((len(FACTORS), k), -np.inf)
    for f, factor in enumerate(FACTORS):
        p, volume = system.projected(factor)
        pulled = p @ c
        for j in range(k):
            rows = slice(3 * j, 3 * j + 3)
            eigenvalue, vector = np.linalg.eigh(p[rows, rows])
            if eigenvalue[0] <= 1e-10 * np.trace(p) / len(p):
                continue  # without this visit the others do not fix the frame
            squared = float(np.sum((vector.T @ pulled[rows]) ** 2 / eigenvalue))
            own = -0.5 * squared + 0.5 * float(np.log(eigenvalue).sum())
            tail[f, j], log_rest[f, j] = chi2.sf(squared, 3), volume - 0.5 * float(c @ pulled) - own
    share = np.exp(log_rest - np.logaddexp.reduce(log_rest, axis=0)) if k else log_rest
    return np.where(np.isfinite(tail).all(axis=0), np.sum(share * np.nan_to_num(tail), axis=0), np.nan)
