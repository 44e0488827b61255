"""What one session says of its labels, and how that is said."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from calibration.faults.hypotheses import FREE, Hypothesis

# Probability of an alarm on right labels, by theory: so much for the labels, and as much for the positions.
ALARM = 0.01


@dataclasses.dataclass(frozen=True)
class Finding:
    """What one session says of its labels.

    Attributes:
        told: location of every visit, as labelled.
        named: what is wrong; the hypothesis `right` where nothing is.
        beside: what cannot be told from `named`; other positions, where positions were the alarm.
        open: label faults that the data do not rule out beside what was named: in a session with such a fault the
            labels as they are now would be as likely, so these are the faults that would have gone unseen.
        log_bayes: log evidence of every hypothesis weighed, over that of the labels as told.
        label_alarm: log of the mean Bayes factor of all label faults; an alarm above -log ALARM. An e-value: on right
            labels its exponential is above 1/ALARM with probability ALARM at most, whatever the noise (Ville 1939).
        tail: (k,) of every visit's leave-one-out prediction; NaN where there is none, or (under wrong labels) where the
            visit is not concerned.
        tested: (k,) whether that tail counts; an alarm where k times the smallest is below ALARM (Bonferroni).
        smallest_m: (k,) shift that would be seen with 95 %, in its visit's worst direction; NaN as `tail`.
        error_m: (k, 3) surveyed minus predicted position; NaN as `tail`.
        mended: where labels are wrong and the right ones known, the finding of the session so labelled.
    """

    told: tuple[str, ...]
    named: Hypothesis
    beside: tuple[Hypothesis, ...]
    open: tuple[Hypothesis, ...]
    log_bayes: dict[Hypothesis, float]
    label_alarm: float
    tail: Float[np.ndarray, "k"]
    tested: Bool[np.ndarray, "k"]
    smallest_m: Float[np.ndarray, "k"]
    error_m: Float[np.ndarray, "k 3"]
    mended: "Finding | None" = None

    @property
    def fault(self) -> bool:
        return self.named.kind != "right"

    @property
    def position_alarm(self) -> float:
        """k times the smallest tail that counts; 1 where none does."""
        return min(1.0, len(self.tail) * float(self.tail[self.tested].min(initial=1.0)))


def fault_words(h: Hypothesis, told: Sequence[str]) -> str:
    """One hypothesis in words; visits are counted from 1 and named as told."""
    named = [f"{i + 1} ({told[i]})" for i in h.visits if i < len(told)]
    match h.kind:
        case "right":
            return "the labels are right"
        case "mislabelled":
            return f"visit {named[0]} is at {h.places[h.visits[0]]}"
        case "shifted":
            return f"visit {named[0]} is not where it was surveyed"
        case "shifted location":
            return f"location {told[h.visits[0]]} is not where it was surveyed, on any of its visits"
        case "jump":
            return f"the odometry jumps between the visits {named[0]} and {named[1]}"
        case "exchanged":
            one, other = dict.fromkeys(told[i] for i in h.visits)
            at = f"the visits {', '.join(named[:-1])} and {named[-1]} are exchanged"
            return at if len(h.visits) == 2 else f"{at}: {one} with {other}"
        case "slipped":
            return f"the labels slip: the visits are {places_words(h.places)}"
        case "missed":
            what = f"place {h.visits[0] + 1} of the order ({told[h.visits[0]]}) was missed"
            return f"{what}: the visits are {places_words(h.places)}"
    at = f"at {h.places[h.visits[0]]}" if h.places[h.visits[0]] != FREE else "nowhere that was surveyed"
    return f"visit {h.visits[0] + 1} is extra ({at}): the visits are {places_words(h.places)}"


def places_words(places: Sequence[str]) -> str:
    """Locations in order, `?` for one that was not surveyed."""
    return " ".join(place if place != FREE else "?" for place in places)


def finding_sentences(found: Finding) -> Iterator[str]:
    """What was found, by which test, what cannot be told from it, and what could not be tested."""
    told = found.told
    if not found.fault:
        yield (
            f"No fault found among {len(told)} visits: labels' mean Bayes factor {bayes_words(found.label_alarm)} "
            f"(alarm above {1 / ALARM:.0f}), positions' probability {found.position_alarm:.2g} (alarm below {ALARM:g})."
        )
    else:
        by = f"Bayes factor {bayes_words(found.log_bayes[found.named])} over the labels as told"
        if found.named.kind == "shifted":
            j = found.named.visits[0]
            off_m = float(np.linalg.norm(found.error_m[j]))
            by = f"{off_m:.2f} m from where the others predict it, probability {found.tail[j]:.1g}; {by}"
        yield f"Found: {fault_words(found.named, told)} ({by})."
    if found.named.kind == "jump":
        yield "That is no fault of an anchor: their labels and positions fit on either side of it."
    for h in found.beside:
        yield f"It cannot be told from: {fault_words(h, told)} (Bayes factor {bayes_words(found.log_bayes[h])})."
    for h in found.open:
        if h not in found.beside:
            yield f"Not ruled out: {fault_words(h, told)} (Bayes factor {bayes_words(found.log_bayes[h])})."
    yield from _untested(found)


def _untested(found: Finding) -> Iterator[str]:
    def visits(which: Bool[np.ndarray, "k"]) -> str:
        return ", ".join(f"{j + 1} ({found.told[j]})" for j in np.flatnonzero(which))

    bent = np.isfinite(found.tail) & ~found.tested
    if bent.any():
        yield (
            f"Positions that cannot be tested: of the visits {visits(bent)}. The drift is too large, or settles too "
            "badly, for a prediction of them to be trusted; their labels were tested."
        )
    missing = np.isnan(found.tail)
    if missing.any() and not found.named.of_labels:
        yield (
            f"Positions that cannot be tested: of the visits {visits(missing)}. Without one of them the others do not "
            "fix the frame; their labels were tested."
        )


def bayes_words(log_bayes: float) -> str:
    """A Bayes factor as a number a reader can hold."""
    if not np.isfinite(log_bayes):
        return "0"
    if abs(log_bayes) < np.log(1e4):
        return f"{np.exp(log_bayes):.2g}"
    return f"1e{log_bayes / np.log(10.0):+.0f}"
