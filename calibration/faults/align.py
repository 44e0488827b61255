"""One visit more or fewer than the order names: which place was missed, or which visit is extra."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from calibration.faults import hypotheses as of
from calibration.faults.find import SCREEN_NATS
from calibration.faults.finding import ALARM
from calibration.faults.hypotheses import FREE, Hypothesis
from calibration.faults.screen import laid_onto, screen
from calibration.faults.session import Session, relabelled, with_anchors
from calibration.faults.small_system import small_system
from calibration.faults.weigh import weigh
from jaxgeo.errors import UndeterminedError

# Alignments whose whole evidence is worked out: all that the screen does not rule out, which are two or three where the
# drift is small, and most where it is not. Screens before their best one counts as found.
EVALUATED, SCREENS = 64, 4


@dataclasses.dataclass(frozen=True)
class Alignment:
    """The places of the visits found.

    Attributes:
        named: the most probable, of kind `missed` or `extra`.
        probability: of it among all alignments by one visit.
        beside: those at least `ALARM` times as probable as `named`, with their probabilities.
    """

    named: Hypothesis
    probability: float
    beside: tuple[tuple[Hypothesis, float], ...]


def align(session: Session, order: Sequence[str]) -> Alignment:
    """All alignments by one visit are equally likely before.

    Args:
        session: of the visits found, under any names.

    Raises:
        ValueError: the number of visits differs from the order's by another number than one.
        UndeterminedError: under no alignment do the visits fix the frame.
    """
    everything = of.alignments(order, len(session.anchors), session.site.name)
    quick = _screened(session, everything)
    ranked = np.argsort(-quick, kind="stable")[:EVALUATED]
    weighed = weigh(session, [everything[i] for i in ranked if quick[i] > quick[ranked[0]] - SCREEN_NATS])
    weighed.sort(key=lambda w: -w.log_evidence)
    value = np.array([w.log_evidence for w in weighed])
    if not np.isfinite(value[0]):
        raise UndeterminedError(
            f"the {len(session.anchors)} visits fix the frame under none of the {len(everything)} ways to lay them "
            "along the order: visits of three locations off one line at least are needed."
        )
    share = np.exp(value - np.logaddexp.reduce(value))
    beside = [(w.hypothesis, float(p)) for w, p in zip(weighed[1:], share[1:], strict=True) if p > ALARM * share[0]]
    return Alignment(weighed[0].hypothesis, float(share[0]), tuple(beside))


def _screened(session: Session, everything: Sequence[Hypothesis]) -> Float[np.ndarray, "h"]:
    """The screen, at the coarse fit of its own best alignment: under any other names the fit has a wrong scale."""
    best = None
    for _ in range(SCREENS):
        quick = screen(session, everything)
        last, best = best, int(np.argmax(quick))
        if best == last:
            break
        session = _laid_along(session, everything[best])
    return quick


def _laid_along(session: Session, h: Hypothesis) -> Session:
    """The session labelled by a hypothesis; an extra visit is surveyed where the others' rigid fit has it."""
    names = [place if place != FREE else session.site.name[0] for place in h.places]
    anchors = relabelled(session.anchors, names, session.site)
    open_ = np.array([place == FREE for place in h.places])
    point = laid_onto(small_system(session).point_m, anchors.surveyed_enh_m, ~open_)
    surveyed = np.where(open_[:, None], point, anchors.surveyed_enh_m)
    return with_anchors(session, dataclasses.replace(anchors, surveyed_enh_m=surveyed))
