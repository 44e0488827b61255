"""Are the anchors of a run right? Closed forms first; where they are suspicious, every fault is weighed.

Nothing of this reaches an estimate: no anchor is changed or left out.
"""

from typing import Any

import numpy as np

from calibration.calibrate import LearnSettings
from calibration.faults import find_fault, gate, session_of, site_of
from calibration.faults.finding import bayes_words
from calibration.faults.gate import Gate
from jaxgeo.cli.check_facts import finding_facts
from jaxgeo.cli.ingest import Ingested
from jaxgeo.config.schema import SessionConfig
from jaxgeo.data import Anchors, Trajectory
from jaxgeo.errors import EstimationError
from jaxgeo.solve.correct import Settings

UNCHANGED = "Nothing was changed: every anchor was used as it is told."


def check_anchors(
    config: SessionConfig,
    data: Ingested,
    trajectory: Trajectory,
    anchors: Anchors,
    settings: Settings,
    learn: LearnSettings,
) -> dict[str, Any]:
    """What metrics.json and the report say: `fault` (None: could not be weighed), `sentences`, `mend`, `gate`, and of
    a search what check.json has."""
    session = session_of(trajectory, anchors, site_of(data.survey, data.frame.origin_enh_m), settings, learn)
    ordered = config.visits.order is not None
    quick = gate(session, ordered=ordered)
    facts: dict[str, Any] = {"gate": {"tail": quick.tail, "log_ratio": quick.log_ratio, "worth": quick.worth}}
    if not quick.worth:
        return facts | {"fault": False, "sentences": [_quick_words(quick)], "mend": []}
    try:
        found = find_fault(session, ordered=ordered)
    except EstimationError as error:
        said = f"The anchors could not be checked: {error}"
        return facts | {"fault": None, "sentences": [_quick_words(quick), said], "mend": []}
    facts |= finding_facts(config, data.visits, session, found)
    if found.fault:
        facts["sentences"].append(UNCHANGED)
    return facts


def cause_words(facts: dict[str, Any] | None) -> str:
    """What a run that did not converge says of its anchors; None: they were not checked."""
    if facts is None:
        return "('jaxgeo check' looks for wrong anchors.)"
    return " ".join([*facts["sentences"], *facts["mend"]])


def check_warnings(facts: dict[str, Any] | None) -> tuple[str, ...]:
    """The finding as one warning; none where nothing was found, or nothing was asked."""
    if facts is None or facts["fault"] is False:
        return ()
    return (" ".join([*facts["sentences"], *facts["mend"]]),)


def _quick_words(quick: Gate) -> str:
    tested = np.isfinite(quick.tail)
    least = (
        f"the least probable of {int(tested.sum())} visits has {np.nanmin(quick.tail):.2g}"
        if tested.any()
        else ("no visit can be left out, since the others would not fix the frame")
    )
    sign = "Suspicious in closed form" if quick.worth else "No sign of a wrong anchor in closed form"
    return (
        f"{sign}: left out one at a time, {least}; the likeliest label fault fits {bayes_words(quick.log_ratio)} times "
        "as well as the labels as told. ('jaxgeo check' weighs every fault.)"
    )
