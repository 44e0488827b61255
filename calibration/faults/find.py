"""Are the labels right? If not: which visit, what is wrong with it, and what could not be told.

Two tests, their limits set by theory. Labels: the mean Bayes factor of all label faults. Positions: each visit's
leave-one-out tail, averaged over what the other visits say of the noise. A finding names and weighs; it drops nothing.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from calibration.faults import hypotheses as of
from calibration.faults.finding import ALARM, Finding
from calibration.faults.hypotheses import FREE, Hypothesis
from calibration.faults.jump import jump_log_bayes
from calibration.faults.predict import Predicted, predict, smallest_shift_m, testable
from calibration.faults.screen import screen
from calibration.faults.session import Session, relabelled, with_anchors
from calibration.faults.weigh import Weighed, log_shift_density, weigh
from jaxgeo.errors import ConvergenceError, UndeterminedError

# Hypotheses of a kind whose whole evidence is worked out, and how far below the best of the screen they may lie.
EVALUATED, SCREEN_NATS = 4, 20.0
# What is as probable as this share of what is named is named beside it.
BESIDE = 0.05
# A location with several visits is tried as shifted where one of them has a tail below this.
WORTH_TAIL = 0.05


def find_fault(session: Session, *, ordered: bool) -> Finding:
    """Test the labels as told; where they are wrong and the right ones known, those too.

    Args:
        ordered: they come from a visiting order, so they may slip.

    Raises:
        UndeterminedError: the visits as labelled do not fix the frame.
        ConvergenceError: no noise explains them as labelled.
    """
    found = _find(session, ordered)
    places = found.named.places
    if not found.named.of_labels or FREE in places:
        return found
    mended = with_anchors(session, relabelled(session.anchors, places, session.site))
    return dataclasses.replace(found, mended=_find(mended, ordered))


def _find(session: Session, ordered: bool) -> Finding:
    told = session.told
    kinds = {"mislabelled": of.mislabelled(told, session.site.name), "exchanged": of.exchanged(told)}
    if ordered:
        kinds["slipped"] = of.slipped(told)
    first, *weighed = weigh(session, [of.right(told), *_best_of_screen(session, kinds)])
    _refuse(first)
    log_bayes = {of.right(told): 0.0} | {w.hypothesis: w.log_evidence - first.log_evidence for w in weighed}
    prior = log_prior(kinds, len(told))
    alarm = float(
        np.logaddexp.reduce([prior[w.hypothesis.kind] + log_bayes[w.hypothesis] for w in weighed] or [-np.inf])
    )
    # Wrong labels bend every visit's prediction: then only those suspected are tried as shifted.
    suspected = _suspected(log_bayes) if alarm > -np.log(ALARM) else set(range(len(told)))
    predicted = predict(session, sorted(suspected))
    for j in np.flatnonzero(predicted.done):
        rest = float(predicted.log_rest[j]) - first.log_evidence
        log_bayes[of.shifted(told)[j]] = rest + log_shift_density(predicted.error_m[j], predicted.covariance_m2[j])
    for w in weigh(session, _locations_worth(told, predicted)):
        log_bayes[w.hypothesis] = w.log_evidence - first.log_evidence
    jumps = _jumps_worth(session, predicted) if alarm <= -np.log(ALARM) else []
    log_bayes |= dict(zip(jumps, jump_log_bayes(session, jumps), strict=True))
    posterior = {h: prior[h.kind] + value for h, value in log_bayes.items() if h.kind != "right"}
    return _decided(session, log_bayes, posterior, alarm, predicted)


def log_prior(kinds: dict[str, list[Hypothesis]], visits: int) -> dict[str, float]:
    """Of one hypothesis of a kind, given a fault: kinds are equally likely, shifts one of them, and so are members."""
    counts = {kind: max(len(members), 1) for kind, members in kinds.items()}
    counts |= {"shifted": visits, "shifted location": visits, "jump": visits}
    return {kind: -float(np.log(count * (len(kinds) + 1))) for kind, count in counts.items()}


def _refuse(first: Weighed) -> None:
    if not first.determined:
        raise UndeterminedError(
            "the visits as labelled do not fix the frame, so nothing can be said of their labels: visits of three "
            "locations off one line at least are needed."
        )
    if not np.isfinite(first.log_evidence):
        raise ConvergenceError(
            "no model of the noise was found under the labels as they are. Check sigmas of survey and sightings."
        )


def _best_of_screen(session: Session, kinds: dict[str, list[Hypothesis]]) -> list[Hypothesis]:
    """Every kind's best hypotheses by the screen; none that lies far below the best of all."""
    everything = [of.right(session.told), *(h for members in kinds.values() for h in members)]
    quick = dict(zip(everything, screen(session, everything), strict=True))
    least = max(quick.values()) - SCREEN_NATS
    chosen = []
    for members in kinds.values():
        chosen += [h for h in sorted(members, key=lambda h: -quick[h])[:EVALUATED] if quick[h] > least]
    return chosen


def _suspected(log_bayes: dict[Hypothesis, float]) -> set[int]:
    """Visits of the most probable label faults."""
    least = max(log_bayes.values()) + np.log(ALARM)
    return {i for h, value in log_bayes.items() for i in h.visits if value > least}


def _locations_worth(told: Sequence[str], predicted: Predicted) -> list[Hypothesis]:
    return [
        h for h in of.shifted_locations(told) if np.nanmin(predicted.tail[list(h.visits)], initial=1.0) < WORTH_TAIL
    ]


def _jumps_worth(session: Session, predicted: Predicted) -> list[Hypothesis]:
    """Jumps on either side of every visit whose position raises the alarm; none between visits at one pose."""
    off = np.flatnonzero(testable(session, predicted) & (predicted.tail < ALARM / len(session.told)))
    apart = np.diff(session.anchors.pose_index) > 0
    return [h for h, between in zip(of.jumps(session.told), apart, strict=True) if between and set(h.visits) & set(off)]


def _decided(
    session: Session,
    log_bayes: dict[Hypothesis, float],
    posterior: dict[Hypothesis, float],
    alarm: float,
    predicted: Predicted,
) -> Finding:
    told, tested = session.told, testable(session, predicted)
    off = len(told) * predicted.tail[tested].min(initial=1.0) < ALARM
    if alarm > -np.log(ALARM):
        named = max(posterior, key=posterior.__getitem__)
    elif off:
        named = named_by_position(told, posterior, np.where(tested, predicted.tail, 1.0))
    else:
        named = of.right(told)
    top = posterior.get(named, 0.0)
    beside = [h for h in posterior if named.kind != "right" and h != named and posterior[h] > top + np.log(BESIDE)]
    # Label faults at least ALARM times as probable as what was named: as a fault, where nothing is.
    open_ = [h for h in posterior if h.of_labels and h != named and posterior[h] > top + np.log(ALARM)]
    return Finding(
        told=told,
        named=named,
        beside=tuple(beside),
        open=tuple(open_),
        log_bayes=log_bayes,
        label_alarm=alarm,
        tail=predicted.tail,
        tested=tested,
        smallest_m=smallest_shift_m(predicted, ALARM),
        error_m=predicted.error_m,
    )


def named_by_position(told: Sequence[str], posterior: dict[Hypothesis, float], tail: np.ndarray) -> Hypothesis:
    """The visit with the least tail, which raised the alarm; a fault of another kind where that is far likelier."""
    visit = of.shifted(told)[int(np.argmin(tail))]
    other = max((h for h in posterior if h.kind != "shifted"), key=posterior.__getitem__, default=visit)
    return other if posterior[other] > posterior[visit] - np.log(BESIDE) else visit
