"""A quick order among hypotheses: which of them are worth the whole evidence.

The trajectory stays as the odometry has it. A hypothesis' surveyed positions s_h are laid onto its markers p by their
own rigid motion S_h, so that a wrong label turns no frame but its own, and

    log L_h = log sum_f N(c_h; X b, R + f^2 V),     c_h = W (p - S_h s_h),     b flat
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from calibration.faults.hypotheses import FREE, Hypothesis
from calibration.faults.session import Session
from calibration.faults.small_system import FACTORS, WORTHLESS, SmallSystem, small_system
from calibration.faults.weigh import log_somewhere_density


def screen(session: Session, hypotheses: Sequence[Hypothesis]) -> Float[np.ndarray, "h"]:
    """log L of every hypothesis, up to a common constant; an open visit is one where nothing was surveyed."""
    system = small_system(session)
    known: dict[int | None, list[tuple[np.ndarray, float]]] = {}
    out = np.empty(len(hypotheses))
    for i, h in enumerate(hypotheses):
        open_ = h.places.index(FREE) if FREE in h.places else None
        if open_ not in known:
            known[open_] = [system.projected(factor, open_) for factor in FACTORS]
        target_m = _places_m(session, h)
        used = np.arange(len(target_m)) != open_
        off_m = np.where(used[:, None], system.point_m - laid_onto(target_m, system.point_m, used), 0.0)
        c = system.whitened(off_m)
        out[i] = np.logaddexp.reduce([volume - 0.5 * c @ p @ c for p, volume in known[open_]])
        if open_ is not None:
            out[i] += _instead(session, system, open_, laid_onto(system.point_m, target_m, used)[open_])
    return out


def _instead(session: Session, system: SmallSystem, visit: int, point_m: Float[np.ndarray, "3"]) -> float:
    """Takes the density of an open visit's worthless rows off, and puts on that of a place that was not surveyed."""
    log_det = np.log(np.diagonal(system.weight[visit])).sum()
    own = 3.0 * np.log(WORTHLESS) + 1.5 * np.log(2.0 * np.pi) - log_det
    return own + log_somewhere_density(point_m, np.zeros((3, 3)), session.site)


def _places_m(session: Session, h: Hypothesis) -> Float[np.ndarray, "k 3"]:
    """Positions by the hypothesis; of an open visit as told."""
    site, told = session.site, session.told
    return np.array(
        [
            session.anchors.surveyed_enh_m[j] if place in (FREE, told[j]) else site.point_m[site.index(place)]
            for j, place in enumerate(h.places)
        ]
    )


def laid_onto(
    source: Float[np.ndarray, "k 3"], target: Float[np.ndarray, "k 3"], used: Bool[np.ndarray, "k"]
) -> Float[np.ndarray, "k 3"]:
    """The source after the rigid motion that fits the target best where used (Kabsch 1976)."""
    a, b = source[used].mean(axis=0), target[used].mean(axis=0)
    u, _, vt = np.linalg.svd((target[used] - b).T @ (source[used] - a))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return (source - a) @ turn.T + b
