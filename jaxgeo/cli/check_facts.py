"""What a search for wrong anchors found, as check.json, metrics.json and the report have it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration.faults import Finding, Hypothesis, Session
    from jaxgeo.config.schema import SessionConfig
    from jaxgeo.data import Visit

# Hypotheses listed, best first.
LISTED = 12


def finding_facts(
    config: "SessionConfig", visits: "Sequence[Visit]", session: "Session", found: "Finding"
) -> dict[str, Any]:
    """Of one trajectory; `visits` are all that were labelled."""
    from calibration.faults import finding_sentences
    from jaxgeo.cli.check_mend import mend_sentences

    facts = {"fault": found.fault} | _weighed_facts(session, found)
    facts["sentences"] = list(finding_sentences(found))
    facts["mend"] = mend_sentences(config, visits, session.anchors, found.named)
    if found.mended is not None:
        again = list(finding_sentences(found.mended))
        facts["mended"] = {"fault": found.mended.fault} | _weighed_facts(session, found.mended) | {"sentences": again}
    return facts


def _weighed_facts(session: "Session", found: "Finding") -> dict[str, Any]:
    ranked = sorted(found.log_bayes.items(), key=lambda pair: -pair[1])[:LISTED]
    visits = [
        {
            "visit": j + 1,
            "location": found.told[j],
            "stamp_s": session.anchors.stamp_s[j],
            "tail": found.tail[j],
            "tested": bool(found.tested[j]),
            "surveyed_minus_predicted_m": found.error_m[j],
            "smallest_detectable_shift_m": found.smallest_m[j],
        }
        for j in range(len(found.told))
    ]
    return {
        "named": hypothesis_facts(found.named, found.told),
        "beside": [hypothesis_facts(h, found.told) for h in found.beside],
        "not_ruled_out": [hypothesis_facts(h, found.told) for h in found.open],
        "log_mean_bayes_factor_of_label_faults": found.label_alarm,
        "position_alarm": found.position_alarm,
        "hypotheses": [hypothesis_facts(h, found.told) | {"log_bayes_factor": value} for h, value in ranked],
        "visits": visits,
    }


def hypothesis_facts(h: "Hypothesis", told: Sequence[str]) -> dict[str, Any]:
    """Visits are counted from 1; a place that was not surveyed is None."""
    from calibration.faults import fault_words

    return {
        "kind": h.kind,
        "visits": [i + 1 for i in h.visits],
        "places": [place or None for place in h.places],
        "words": fault_words(h, told),
    }
